# SPDX-License-Identifier: Apache-2.0
"""The bounds of a vehicle's safety filter."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from runtime.errors import ConfigError
from runtime.safety.config import Age, CommonSafetyConfig

Speed = Annotated[float, Meta(gt=0.0, le=20.0)]
Acceleration = Annotated[float, Meta(gt=0.0, le=20.0)]
Angle = Annotated[float, Meta(gt=0.0, le=3.2)]


class VehicleSafetyConfig(CommonSafetyConfig, frozen=True, forbid_unknown_fields=True):
    """Limits of a vehicle on steered wheels, each wheel's speed over ground.

    Attributes:
        speed_max_mps: commanded speeds of wheels are scaled down to this, all alike.
        speed_margin_mps: a measured one so much above it stops the vehicle for good.
        acceleration_max_mps2: commanded speeds change no faster,
        halt_mps2: nor when the vehicle slows to a stand,
        brake_mps2: nor when it stops for good, until
        stop_max_ns: after which the brakes are put on, whether it stands or not.
        steering_max_rad: commanded angles are clipped to this.
        steering_rate_max_radps: and change no faster.
        steering_error_rad: a wheel whose angle is further from the commanded one, and does not
        steering_step_rad: turn by this
        steering_stuck_ns: within so long, is stuck.
        refusal_ns: a control unit that does not drive for so long though it is told to stops the vehicle for good.
        state_late_ns: with a state frame older than this there is a warning,
        state_age_max_ns: and with an older one of a wheel, or of the unit itself, the vehicle stops for good,
        slow_state_age_max_ns: as it does with an older one of those that come seldom.
    """

    speed_max_mps: Speed = 2.5
    speed_margin_mps: Speed = 1.0
    acceleration_max_mps2: Acceleration = 2.0
    halt_mps2: Acceleration = 1.5
    brake_mps2: Acceleration = 3.0
    stop_max_ns: Age = 2_000_000_000
    steering_max_rad: Angle = 1.5708
    steering_rate_max_radps: Annotated[float, Meta(gt=0.0, le=20.0)] = 3.0
    steering_error_rad: Angle = 0.15
    steering_step_rad: Angle = 0.02
    steering_stuck_ns: Age = 500_000_000
    refusal_ns: Age = 300_000_000
    state_late_ns: Age = 15_000_000
    state_age_max_ns: Age = 50_000_000
    slow_state_age_max_ns: Age = 500_000_000

    def check(self) -> None:
        """Cross-checks.

        Raises:
            ConfigError: naming the key and the bound.
        """
        super().check()
        self.check_order(("halt_mps2", "brake_mps2"), ("state_late_ns", "state_age_max_ns"))
        stopping_ns = round(self.speed_max_mps / self.brake_mps2 * 1e9)
        if self.stop_max_ns < stopping_ns:
            raise ConfigError(
                f"stop_max_ns = {self.stop_max_ns} is below speed_max_mps / brake_mps2 = {stopping_ns} ns"
            )
