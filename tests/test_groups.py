# SPDX-License-Identifier: Apache-2.0
"""Tests that share a run, or the clock, are kept together by pytest-xdist, which not every pytest lets it do."""

import os

import pytest


@pytest.mark.skipif("PYTEST_XDIST_WORKER" not in os.environ, reason="the tests run in one process")
@pytest.mark.xdist_group("together")
def test_a_group_of_tests_is_told_to_who_hands_them_out(request):
    assert request.node.nodeid.endswith("@together")
