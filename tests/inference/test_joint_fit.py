"""The elimination of what is a window's own, against the whole problem solved at once."""

from __future__ import annotations

import numpy as np
import torch

from expertaug.inference.joint_fit import NormalEquations, Tied, clustered_variances, eliminate

N, K, PLACES, OWN = 5, 4, [1, 3], [0, 2]


def problem():
    """Residuals r + J x of N windows with K coordinates, of which all share those at PLACES; and its equations."""
    generator = torch.Generator().manual_seed(0)
    jacobian = torch.randn(N, 7, K, generator=generator, dtype=torch.float64)
    r = torch.randn(N, 7, generator=generator, dtype=torch.float64)
    slope = (jacobian.mT @ r.unsqueeze(-1)).squeeze(-1)
    whole = np.zeros((N * 7, len(PLACES) + N * len(OWN)))
    for k in range(N):
        rows, own = slice(7 * k, 7 * (k + 1)), slice(2 + 2 * k, 4 + 2 * k)
        whole[rows, :2], whole[rows, own] = jacobian[k][:, PLACES], jacobian[k][:, OWN]
    return NormalEquations(r.square().sum(1), jacobian.mT @ jacobian, slope), whole, r.flatten().numpy()


def test_what_is_left_gives_the_step_of_the_whole_problem():
    equations, whole, r = problem()
    expected = -np.linalg.lstsq(whole, r)[0]
    reduced, left, follow, rest, own = eliminate(equations, PLACES, 0.0)
    shared = -torch.linalg.solve(reduced.sum(0), left.sum(0))
    assert own == OWN
    np.testing.assert_allclose(shared, expected[:2], rtol=1e-6)
    np.testing.assert_allclose(-(rest + follow @ shared).flatten(), expected[2:], rtol=1e-6)


def test_of_one_group_errors_are_those_of_the_curvature_and_scatter_makes_them_larger_alone():
    equations, whole, _ = problem()
    least = np.linalg.inv(whole.T @ whole).diagonal()[:2]
    np.testing.assert_allclose(clustered_variances(equations, PLACES, np.zeros(N)), least, rtol=1e-6)
    assert (clustered_variances(equations, PLACES, np.arange(N)).numpy() >= least * (1 - 1e-6)).all()


def test_windows_of_a_trajectory_begin_alike_and_their_equations_add_up():
    tied = Tied.of([0], {"a": np.array([0, 2, 4]), "b": np.array([1, 3])})
    x = torch.arange(10.0).view(1, 5, 2)
    assert tied.groups.tolist() == [0, 1, 0, 1, 0] and tied.first.tolist() == [0, 1]
    assert tied.alike(x)[0, :, 0].tolist() == [4, 2, 4, 2, 4] and torch.equal(tied.alike(x)[..., 1], x[..., 1])
    equations, _, _ = problem()
    assert torch.allclose(tied.summed(equations).slope[1], equations.slope[[1, 3]].sum(0))
