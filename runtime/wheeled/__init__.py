# SPDX-License-Identifier: Apache-2.0
"""Steering kinematics of vehicles with four steered, driven wheels, and predictive path tracking."""
