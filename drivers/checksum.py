# SPDX-License-Identifier: Apache-2.0
"""CRC-8 SAE J1850: polynomial 0x1D, start 0xFF, final XOR 0xFF, not reflected (check value 0x4B)."""

from __future__ import annotations

_POLYNOMIAL = 0x1D
_START = _FINAL = 0xFF


def _table() -> bytes:
    def of(byte: int) -> int:
        for _ in range(8):
            byte = (byte << 1 ^ (_POLYNOMIAL if byte & 0x80 else 0)) & 0xFF
        return byte

    return bytes(of(byte) for byte in range(256))


_TABLE = _table()


def crc8(data: bytes) -> int:
    """The checksum of some bytes."""
    crc = _START
    for byte in data:
        crc = _TABLE[crc ^ byte]
    return crc ^ _FINAL
