# SPDX-License-Identifier: Apache-2.0
"""Faults, injected where they happen, and what the robot is to do about each."""
