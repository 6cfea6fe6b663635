# SPDX-License-Identifier: Apache-2.0
"""Bytes to physical units and back, and the buses that carry the bytes."""
