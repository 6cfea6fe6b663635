# SPDX-License-Identifier: Apache-2.0
"""The command `ugv`, one module per verb; each imports what is heavy only when it runs."""
