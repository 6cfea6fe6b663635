# SPDX-License-Identifier: Apache-2.0
"""Paths, pure pursuit, look-ahead policies and Mamdani fuzzy inference."""
