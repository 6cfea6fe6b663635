# SPDX-License-Identifier: Apache-2.0
"""Small vector algebra against numpy's."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from runtime.models.vectors import cross, skew, total_moment


@given(st.integers(0, 2**32 - 1))
def test_all_are_the_cross_product(seed):
    a, b = np.random.default_rng(seed).standard_normal((2, 4, 3))
    expected = np.cross(a, b)
    np.testing.assert_allclose(cross(a[0], b[0]), expected[0], atol=1e-14)
    np.testing.assert_allclose(skew(a[0]) @ b[0], expected[0], atol=1e-14)
    np.testing.assert_allclose(total_moment(a, b), expected.sum(axis=0), atol=1e-14)
