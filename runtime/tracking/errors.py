# SPDX-License-Identifier: Apache-2.0
"""The error of this package."""

from runtime.errors import UgvError


class PathError(UgvError, ValueError):
    """A path that cannot be followed; its message is one sentence that names the place and the value."""
