# SPDX-License-Identifier: Apache-2.0
"""Error codes become sentences, and bus loads are those of the design."""

import pytest

from drivers.bus_load import check_bus_load, least_bus_load, worst_bus_load
from drivers.dialects import AK_V3, CLASSIC_6, CLASSIC_8, DAMIAO, DIALECTS
from drivers.errors import DriverConfigError
from drivers.faults import FaultKind, code_of, explain_fault, is_healthy

MEGABIT = 1_000_000


@pytest.mark.parametrize(
    ("dialect", "code", "kind"),
    [
        (CLASSIC_8, 1, FaultKind.MOTOR_OVER_TEMPERATURE),
        (AK_V3, 5, FaultKind.ENCODER),
        (DAMIAO, 0x8, FaultKind.OVER_VOLTAGE),
        (DAMIAO, 0x9, FaultKind.UNDER_VOLTAGE),
        (DAMIAO, 0xA, FaultKind.OVER_CURRENT),
        (DAMIAO, 0xB, FaultKind.DRIVER_OVER_TEMPERATURE),
        (DAMIAO, 0xC, FaultKind.MOTOR_OVER_TEMPERATURE),
        (DAMIAO, 0xD, FaultKind.LOST_COMMUNICATION),
        (DAMIAO, 0xE, FaultKind.OVERLOAD),
    ],
)
def test_a_fault_has_a_cause_and_stops_the_robot(dialect, code, kind):
    fault = explain_fault(dialect, code, "front_left_knee")
    assert (fault.kind, fault.stops) == (kind, True)
    assert fault.sentence.startswith(f"drive of front_left_knee: error {code:#x}: ")
    assert code_of(dialect, kind) == code


@pytest.mark.parametrize("name", sorted(DIALECTS))
def test_every_code_has_a_sentence_and_unknown_ones_stop_the_robot(name):
    for code in range(256):
        fault = explain_fault(DIALECTS[name], code, "j")
        assert fault.sentence
        assert fault.stops is not is_healthy(DIALECTS[name], code)
    assert explain_fault(DIALECTS[name], 0x77, "j").kind is FaultKind.UNKNOWN


def test_damiao_reports_enabled_where_others_report_faults():
    assert is_healthy(DAMIAO, 0)
    assert is_healthy(DAMIAO, 1)
    assert not is_healthy(CLASSIC_8, 1)
    assert code_of(CLASSIC_6, FaultKind.OVER_CURRENT) is None


@pytest.mark.parametrize(
    ("dialect", "rate", "least", "worst"),
    [(CLASSIC_8, 500, 0.333, 0.405), (CLASSIC_8, 1000, 0.666, 0.81), (AK_V3, 1000, 0.786, 0.96)],
)
def test_three_drives_on_a_megabit_bus(dialect, rate, least, worst):
    assert least_bus_load(dialect, 3, rate, MEGABIT) == pytest.approx(least)
    assert worst_bus_load(dialect, 3, rate, MEGABIT) == pytest.approx(worst)


def test_twelve_drives_on_one_bus_take_2_7_to_3_2_ms():
    assert least_bus_load(CLASSIC_8, 12, 1, MEGABIT) == pytest.approx(2.664e-3)
    assert worst_bus_load(CLASSIC_8, 12, 1, MEGABIT) == pytest.approx(3.24e-3)


def test_a_rate_that_the_bus_cannot_carry_is_refused_with_the_numbers():
    assert check_bus_load(CLASSIC_8, 3, 1000, MEGABIT) == pytest.approx(0.81)
    with pytest.raises(DriverConfigError, match=r"can0: 1000 Hz with 3 ak-v3 drives .* by 96.0%.* 85%; at most 885 Hz"):
        check_bus_load(AK_V3, 3, 1000, MEGABIT, "can0")
