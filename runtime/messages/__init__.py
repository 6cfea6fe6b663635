# SPDX-License-Identifier: Apache-2.0
"""Standard ROS 2 messages as CDR bytes, and zenoh as ROS 2 speaks it."""
