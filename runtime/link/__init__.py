# SPDX-License-Identifier: Apache-2.0
"""The process between zenoh and the loops."""
