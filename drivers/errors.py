# SPDX-License-Identifier: Apache-2.0
"""The errors that drivers raise."""

from __future__ import annotations


class DriverError(Exception):
    """Anything that a driver refuses; the message names the thing, the value and the bound."""


class DriverConfigError(DriverError):
    """A configuration that contradicts itself or that the drive or the bus cannot carry."""


class LinkDownError(DriverConfigError):
    """A bus whose link is down, and may come up."""


class NonFiniteError(DriverError):
    """A value that is NaN or infinite was to be encoded."""


class FrameError(DriverError):
    """Bytes that are no CAN frame."""
