# SPDX-License-Identifier: Apache-2.0
"""The log of a run: written as a rosbag2 directory, read back, recovered, replayed and reported."""
