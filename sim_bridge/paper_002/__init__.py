# SPDX-License-Identifier: Apache-2.0
"""The experiments of paper 002: coming to a line and following curves, by several methods, on several plants."""
