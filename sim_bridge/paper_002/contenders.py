# SPDX-License-Identifier: Apache-2.0
"""The methods of tracking that are compared: the vehicle's own controllers, each with what it makes of the delay."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

from runtime.robots import load_configuration
from runtime.robots.predictive_policy import PredictivePolicy
from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from runtime.tracking.drive_tracker_config import SolveMemory
from runtime.tracking.vehicle_tracker import SteeringPolicy

ROBOT = "4ws4wd"
FASTEST_RADPS = 20.0
"""Rate of the centre angle that stands for one without a limit."""
FASTEST_RETURN_RADPS = math.radians(60.0)
"""Above this the period of the commands bounds the return to the path, and no longer the steering."""


class DelayHandling(Enum):
    """What a method makes of delays: that from a command to the wheels, and that of the pose.

    One that ignores them takes a late pose for the present one, as the paper's vehicle does. The others have its stamp
    and the wheels' encoders, and carry it on to the present, as the vehicle's filter does; what is left for them to
    know or to learn is the delay of the commands.
    """

    IGNORED = "ignored"
    KNOWN = "known"
    LEARNT = "learnt"


class Contender(NamedTuple):
    """A method of tracking.

    Attributes:
        name: as it is printed.
        controller: of the vehicle.
        delay: what is made of it: the pose is predicted over one that is known, or over one that is learnt from the
            vehicle's answers while it drives.
        settings: configuration keys and values in which it differs from the vehicle's own.
    """

    name: str
    controller: str
    delay: DelayHandling = DelayHandling.IGNORED
    settings: Mapping[str, str] = {}


def configuration(contender: Contender, rate_radps: float, lag_s: float) -> Vehicle4ws4wdConfig:
    """The vehicle's configuration with a contender at the wheel.

    Args:
        contender: which.
        rate_radps: of the centre angle, as the contender knows it; may be infinite.
        lag_s: of the centre angle, likewise.
    """
    chosen = {"variant.controller": contender.controller}
    config = load_configuration(ROBOT, {**steering_settings(rate_radps, lag_s), **chosen, **contender.settings})
    assert isinstance(config, Vehicle4ws4wdConfig)
    return config


def steering_settings(rate_radps: float, lag_s: float) -> dict[str, str]:
    """Configuration keys and values that tell every controller how the steering answers."""
    rate = min(rate_radps, FASTEST_RADPS)
    answers = {
        "tracker.following.answer": rate,
        "controllers.steered_return.answer": min(rate, FASTEST_RETURN_RADPS),
        "controllers.mpc": rate,
    }
    rates = {f"{place}.rate_radps": repr(value) for place, value in answers.items()}
    return {**rates, **{f"{place}.lag_s": repr(lag_s) for place in answers}}


def policy_of(config: Vehicle4ws4wdConfig) -> SteeringPolicy:
    """The controller that a configuration chooses."""
    if config.variant.controller == "mpc":
        return PredictivePolicy(config.controllers.mpc, SolveMemory("/ugv/state/tracker"))
    return config.policy


def _with_gain(gain: float) -> Mapping[str, str]:
    return {"controllers.ldc.longitudinal_gain": repr(gain)}


LEARNT, KNOWN = DelayHandling.LEARNT, DelayHandling.KNOWN
PLAIN = Contender("pure pursuit", "pure-pursuit")
GAINS = (
    PLAIN,
    *(Contender(f"LDC, K_r {gain}", "ldc", settings=_with_gain(gain)) for gain in (0.6, 0.9, 1.2)),
)
"""Those of the paper's straight experiment."""
LONGER = {"controllers.regulated.look_ahead_s": "2.5", "controllers.regulated.maximum_m": "1.5"}
"""At 0.6 m/s the look-ahead distance of the others."""
FUZZY = Contender("fuzzy", "fuzzy")
PAPERS = Contender("fuzzy + LDC (the paper's)", "fuzzy-ldc")
COMPENSATED = Contender("fuzzy + LDC, delay learnt", "fuzzy-ldc", LEARNT)
OURS = Contender("steered return (ours), delay learnt", "steered-return", LEARNT)
OURS_TOLD = Contender("steered return, delay known", "steered-return", KNOWN)
CONTENDERS = (
    PLAIN,
    Contender("pure pursuit, delay learnt", "pure-pursuit", LEARNT),
    GAINS[2],
    FUZZY,
    PAPERS,
    COMPENSATED,
    Contender("regulated pure pursuit", "regulated"),
    Contender("regulated, look-ahead 1.5 m", "regulated", settings=LONGER),
    Contender("kinematic MPC, delay learnt", "mpc", LEARNT),
    Contender("kinematic MPC, delay known", "mpc", KNOWN),
    OURS,
    OURS_TOLD,
)
"""Those that are compared on every course and plant."""
