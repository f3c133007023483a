"""Variance components of offsets by restricted maximum likelihood (REML), the zero boundary included.

    fit = fit_variance_components(offset, fixed, {"day": day_columns, "run": run_columns})

The model is y = X alpha + sum of Z_p beta_p + e, Read (1990) (20) and Patterson and Thompson, (A.1)-(A.5). All
that the data say of the components is in Z'SZ, Z'Sy and y'Sy (A.6), so these are made once. Where the report
iterates (A.7)-(A.13), which goes wrong when a component is driven to zero, Newton's steps go down the same
likelihood with the components at zero held there while it falls no lower by letting them go.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.stats import chi2

from trackerlib.compiled import compiled, warms

STARTS = (1.0, 0.05)  # every ratio gamma; the lowest place of all is kept
STEPS = 100
REST = 1e-9  # Newton decrement at which a search is at rest: of twice the log-likelihood
UNSEEN = 1e-9  # of a column's own square: less is left of it when the fixed effects are taken out
FARTHEST = 1e6  # times the estimate, where the upper end of an interval is no longer looked for


@dataclass(frozen=True, eq=False)
class VarianceComponents:
    """Variances of random effects and of what is left, in the square of the offsets' unit."""

    names: tuple[str, ...]  # of the random effects
    variance: np.ndarray  # (C,)
    residual: float
    converged: bool
    log_likelihood: float  # restricted, without the constants that hold no component
    freedom: float  # Satterthwaite's degrees of freedom of the residual variance
    not_estimable: tuple[str, ...]  # effects that the fixed effects take up wholly

    @property
    def gamma(self) -> np.ndarray:
        """Ratios (C,) of the components to the residual (A.4)."""
        return self.variance / self.residual

    @property
    def at_boundary(self) -> tuple[str, ...]:
        """Names of the components that are zero."""
        return tuple(name for name, value in zip(self.names, self.variance, strict=True) if value == 0)


@dataclass(frozen=True, eq=False)
class _Sums:
    """The data with the fixed effects taken out."""

    across: np.ndarray  # (Q, Q) Z'SZ
    along: np.ndarray  # (Q,) Z'Sy
    square: float  # y'Sy
    freedom: int  # n - t
    block: np.ndarray  # (Q,) which effect a column belongs to
    effects: int


def fit_variance_components(
    offset: np.ndarray, fixed: np.ndarray, random: Mapping[str, np.ndarray]
) -> VarianceComponents:
    """Components of the random effects and of the residual that make the restricted likelihood greatest.

    offset : (N,) in any one unit; fixed : (N, T) columns X; random : name -> columns Z_p (N, L_p)
    An effect that the fixed effects take up wholly is not estimable, and its variance 0.
    Raises ValueError where the fixed effects leave no degree of freedom, or nothing varies.
    """
    sums, unseen = _sums(np.asarray(offset, float), np.asarray(fixed, float), random)
    try:
        gamma, decrement = _lowest(
            sums.across, sums.along, sums.square, sums.freedom, sums.block, sums.effects
        )
    except ValueError:  # the likelihood grows without bound
        raise ValueError(
            "all effects together fit every offset exactly; no variance is left for the residual"
        ) from None
    gamma[[name in unseen for name in random]] = 0.0
    minus_twice, sum_left, _, _ = _at(
        gamma, sums.across, sums.along, sums.square, sums.freedom, sums.block, sums.effects
    )
    residual = sum_left / sums.freedom
    variance = gamma * residual
    names = tuple(random)
    return VarianceComponents(
        names=names,
        variance=variance,
        residual=residual,
        converged=bool(decrement < REST),
        log_likelihood=-0.5 * (minus_twice + sums.freedom * (1 - np.log(sums.freedom))),
        freedom=float(_satterthwaite(gamma, sums.across, sums.along, sums.freedom, sums.block, sums.effects)),
        not_estimable=unseen,
    )


def profile_intervals(
    offset: np.ndarray, fixed: np.ndarray, random: Mapping[str, np.ndarray], fit: VarianceComponents
) -> np.ndarray:
    """95 % intervals (C + 1, 2) of the components of a fit, the residual's last; NaN where not estimable.

    By profile likelihood: an interval may begin at zero, and with few days it is long.
    """
    sums, _ = _sums(np.asarray(offset, float), np.asarray(fixed, float), random)
    theta = np.append(fit.variance, fit.residual)
    return np.array(
        [
            (np.nan, np.nan) if name in fit.not_estimable else _profile_interval(sums, theta, p)
            for p, name in enumerate((*fit.names, "residual"))
        ]
    )


def restricted_log_likelihood(
    offset: np.ndarray, fixed: np.ndarray, random: Mapping[str, np.ndarray], theta: np.ndarray
) -> float:
    """Restricted log-likelihood at variances theta (C + 1,), the residual's last; constants left out."""
    sums, _ = _sums(np.asarray(offset, float), np.asarray(fixed, float), random)
    return -0.5 * _minus_twice(np.asarray(theta, float), sums)[0]


def _sums(offset, fixed, random) -> tuple[_Sums, tuple[str, ...]]:
    basis, strength, _ = np.linalg.svd(fixed, full_matrices=False)
    basis = basis[:, strength > 1e-10 * strength[0]]
    freedom = len(offset) - basis.shape[1]
    if freedom < 1:
        raise ValueError(
            f"{len(offset)} offsets and {basis.shape[1]} fixed effects leave nothing to tell a variance from"
        )
    columns = np.column_stack([*random.values(), offset])
    seen = columns
    for _ in range(2):  # twice, so that what rounding left of the fixed effects goes too
        seen = seen - basis @ (basis.T @ seen)
    z, left = seen[:, :-1], seen[:, -1]
    if not left @ left > 1e-20 * (offset @ offset):
        raise ValueError("the fixed effects fit every offset exactly; there is no variance to share out")
    block = np.repeat(np.arange(len(random)), [effect.shape[1] for effect in random.values()])
    share = np.bincount(block, np.sum(z**2, axis=0)) / np.bincount(
        block, np.sum(columns[:, :-1] ** 2, axis=0)
    )
    z = z * (share > UNSEEN)[block]
    unseen = tuple(name for name, part in zip(random, share, strict=True) if part <= UNSEEN)
    return _Sums(z.T @ z, z.T @ left, float(left @ left), freedom, block, len(random)), unseen


@compiled
def _solve(across, along, gamma, block):
    """(I + A Gamma)^-1 of A and b, side by side (Q, Q + 1), and the logarithm of its determinant.

    All pivots are above zero in any order: the matrix is similar to a positive definite one.
    """
    count = len(along)
    matrix, solved = np.empty((count, count)), np.empty((count, count + 1))
    for i in range(count):
        for j in range(count):
            solved[i, j] = across[i, j]
            matrix[i, j] = across[i, j] * gamma[block[j]]
        solved[i, count] = along[i]
        matrix[i, i] += 1.0
    log_det = 0.0
    for k in range(count):
        log_det += np.log(matrix[k, k])
        for i in range(k + 1, count):
            share = matrix[i, k] / matrix[k, k]
            if share != 0.0:
                for j in range(k + 1, count):
                    matrix[i, j] -= share * matrix[k, j]
                for j in range(count + 1):
                    solved[i, j] -= share * solved[k, j]
    for k in range(count - 1, -1, -1):
        for j in range(count + 1):
            solved[k, j] /= matrix[k, k]
        for i in range(k):
            share = matrix[i, k]
            if share != 0.0:
                for j in range(count + 1):
                    solved[i, j] -= share * solved[k, j]
    return solved, log_det


@compiled
def _at(gamma, across, along, square, freedom, block, effects):
    """Twice the negative profiled log-likelihood, y'Py, gradient (C,) and Hessian (C, C) by gamma.

    With T = Z'PZ = (I + A Gamma)^-1 A and c = Z'Py = (I + A Gamma)^-1 b all is well defined at gamma = 0 too.
    """
    count = len(along)
    solved, log_det = _solve(across, along, gamma, block)
    left = square
    size, trace = np.zeros(effects), np.zeros(effects)
    pulled, squared = np.zeros((effects, effects)), np.zeros((effects, effects))
    for i in range(count):
        p, c = block[i], solved[i, count]
        left -= along[i] * gamma[p] * c
        size[p] += c * c
        trace[p] += solved[i, i]
        for j in range(count):
            q = block[j]
            squared[p, q] += solved[i, j] * solved[j, i]
            pulled[p, q] += c * solved[i, j] * solved[j, count]
    gradient = trace - freedom / left * size
    hessian = np.empty((effects, effects))
    for p in range(effects):
        for q in range(effects):
            hessian[p, q] = (
                -squared[p, q] + 2 * freedom / left * pulled[p, q] - freedom / left**2 * size[p] * size[q]
            )
    return freedom * np.log(left) + log_det, left, gradient, hessian


@compiled
def _downhill(gamma, across, along, square, freedom, block, effects):
    """Newton's steps in place, halved until the likelihood rises; the last value and Newton decrement."""
    value, _, gradient, hessian = _at(gamma, across, along, square, freedom, block, effects)
    decrement = np.inf
    for _ in range(STEPS):
        free = np.empty(effects, np.bool_)
        for p in range(effects):
            free[p] = gamma[p] > 0 or gradient[p] < 0
        step = np.zeros(effects)
        chosen = np.flatnonzero(free)
        if len(chosen):
            part = np.empty((len(chosen), len(chosen)))
            slope = np.empty(len(chosen))
            for i in range(len(chosen)):
                slope[i] = gradient[chosen[i]]
                for j in range(len(chosen)):
                    part[i, j] = hessian[chosen[i], chosen[j]]
            values, vectors = np.linalg.eigh(part)
            floor = 1e-10 * np.max(np.abs(values)) + 1e-300
            moved = vectors @ ((vectors.T @ slope) / np.maximum(np.abs(values), floor))
            for i in range(len(chosen)):
                step[chosen[i]] = -moved[i]
        decrement = -np.sum(step * gradient)
        if decrement < REST:
            break
        share, better = 1.0, False
        while share > 1e-8:
            trial = np.maximum(gamma + share * step, 0.0)
            there = _at(trial, across, along, square, freedom, block, effects)
            if there[0] < value:
                better = True
                break
            share /= 2
        if not better:
            break
        gamma[:] = trial
        value, _, gradient, hessian = there
    return value, decrement


@compiled
def _lowest(across, along, square, freedom, block, effects):
    """The ratios (C,) of greatest likelihood over several starts, and the Newton decrement there."""
    best, best_value, best_decrement = np.zeros(effects), np.inf, np.inf
    for start in STARTS:
        gamma = np.full(effects, start)
        value, decrement = _downhill(gamma, across, along, square, freedom, block, effects)
        if value < best_value - 1e-12:
            best, best_value, best_decrement = gamma, value, decrement
    for p in range(effects):  # each component at zero, from where the others ended
        gamma = best.copy()
        if gamma[p] == 0:
            continue
        gamma[p] = 0.0
        value, decrement = _downhill(gamma, across, along, square, freedom, block, effects)
        if value < best_value - 1e-12:
            best, best_value, best_decrement = gamma, value, decrement
    return best, best_decrement


def _minus_twice(theta: np.ndarray, sums: _Sums) -> tuple[float, np.ndarray]:
    """Twice the negative restricted log-likelihood and its gradient at variances (C + 1,), the residual's last."""
    residual = theta[-1]
    gamma = theta[:-1] / residual
    solved, log_det = _solve(sums.across, sums.along, gamma, sums.block)
    c, diagonal = solved[:, -1], np.diag(solved)
    left = sums.square - sums.along @ (gamma[sums.block] * c)
    value = sums.freedom * np.log(residual) + log_det + left / residual
    by_gamma = np.bincount(sums.block, diagonal - c**2 / residual, sums.effects)
    by_residual = sums.freedom / residual - left / residual**2 - by_gamma @ gamma / residual
    return float(value), np.append(by_gamma / residual, by_residual)


def _profile_interval(sums: _Sums, theta: np.ndarray, p: int) -> tuple[float, float]:
    """Where the likelihood, the other components at their best, has fallen by what chi-square allows in 95 %."""
    unit = np.full(len(theta), sums.square / sums.freedom)
    unit[-1] = theta[-1]  # which may be small beside what the runs lie apart
    best = _minus_twice(theta, sums)[0]
    others = np.delete(np.arange(len(theta)), p)
    limits = [(1e-6 if q == len(theta) - 1 else 0.0, None) for q in others]
    start = {"theta": theta / unit}  # the last value's best, from which the next one's is sought

    def rise(value: float) -> float:
        def misfit(rest):
            full = np.empty(len(theta))
            full[p], full[others] = value, rest
            total, gradient = _minus_twice(full * unit, sums)
            return total - best, (gradient * unit)[others]

        begins = [np.maximum(one[others], 1e-3) for one in (start["theta"], theta / unit)]
        found = minimize(
            misfit, min(begins, key=lambda rest: misfit(rest)[0]), jac=True, method="L-BFGS-B", bounds=limits
        )
        start["theta"] = np.insert(found.x, p, value)
        return float(found.fun - chi2.ppf(0.95, 1))

    estimate = theta[p] / unit[p]
    low, above = 0.0, estimate
    if p == len(theta) - 1:  # at zero nothing is likely
        low = estimate / 2
        while rise(low) < 0:
            low, above = low / 2, low
    low = low if rise(low) < 0 else brentq(rise, low, above, xtol=1e-5, rtol=1e-3)
    below, high = estimate, max(2 * estimate, 0.1)
    while rise(high) < 0 and high < FARTHEST * max(estimate, 0.1):
        below, high = high, 2 * high
    high = brentq(rise, below, high, rtol=1e-3) if rise(high) > 0 else np.inf
    return low * unit[p], high * unit[p]


@compiled
def _satterthwaite(gamma, across, along, freedom, block, effects):
    """Degrees of freedom that make the residual variance's spread that of a chi-square: 2 v^2 / var v.

    From the expected information (A.12) of the components that are above zero; it does not hold the residual.
    """
    count = len(along)
    t, _ = _solve(across, along, gamma, block)
    information = np.zeros((effects + 1, effects + 1))
    total = float(freedom)  # tr PP, with P = S - S Z Gamma Z' P
    for i in range(count):
        p, g = block[i], gamma[block[i]]
        total -= 2 * g * t[i, i]
        information[p, effects] += t[i, i]  # tr Z_p' PP Z_p = tr T_pp - (T Gamma T)_pp
        for j in range(count):
            both = t[i, j] * t[j, i]
            information[p, block[j]] += both
            information[p, effects] -= gamma[block[j]] * both
            total += g * gamma[block[j]] * both
    information[effects, effects] = total
    for p in range(effects):
        information[effects, p] = information[p, effects]
        if gamma[p] == 0:
            information[p, :] = 0.0
            information[:, p] = 0.0
            information[p, p] = 1.0
    return 1 / np.linalg.inv(information)[effects, effects]


@warms
def _warm() -> None:
    block = np.array([0, 0, 1])
    gamma, _ = _lowest(np.eye(3), np.ones(3), 9.0, 4, block, 2)
    _satterthwaite(gamma, np.eye(3), np.ones(3), 4, block, 2)
