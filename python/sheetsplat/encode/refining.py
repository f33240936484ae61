"""Few free ellipsoids fitted to samples: all their numbers at once, by steps of Gauss and Newton.

:func:`greedy` finds kernels for samples, :func:`refine` improves kernels that there are. A step solves
(J^T w J + damping) x = -J^T w (sum - data) by conjugate gradients, preconditioned by the blocks of single kernels;
Levenberg's and Marquardt's damping follows how well the model foretold the last step (Nielsen 1999, Damping parameter
in Marquardt's method, eq. 2.4). The numbers of a kernel are changes in its own space, so that the equations do not
depend on its size, place and direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from sheetsplat import _sheetsplat
from sheetsplat._waiting import ask, asking, note, part
from sheetsplat.encode.free import (
    CENTER,
    COLUMNS,
    FALLOFF,
    FRAME,
    VALUE,
    Ellipsoids,
    Floats,
    Samples,
    frame_numbers,
    triangles,
)
from sheetsplat.encode.starting import Bins, starts
from sheetsplat.errors import complain
from sheetsplat.options.renderer import Progress

# Of a step: steps of conjugate gradients at most, and the share of the equations that they leave.
_INNER = 60
_LEFT = 0.1
# How far a step may move a centre, in semi-axes, and change a logarithm of a semi-axis.
_LARGEST_MOVE = 0.5
_LARGEST_CHANGE = 0.7
# The damping of the first step, and what it may become: with more nothing moves.
_DAMPING = (1e-2, 1e-12, 1e8)
# A part of the largest block that is added to all, so that numbers that nothing depends on stay as they are.
_FLOOR = 1e-12
# What values as large as the samples' range add to the objective, as a share of it: so kernels do not grow against each
# other, and what is met exactly still is.
_RIDGE = 0.01
# The objective in units of all weights that rounding leaves.
_NOTHING = 1e-30
# An iteration that gains a smaller share of the objective ends a refinement between additions, or the last one.
_ENOUGH = (1e-3, 1e-6)
# Iterations of new kernels alone, of all after these were added, and of all in the end.
_ALONE = 6
_TOGETHER = 4
_FINAL = 40
# The share of the kernels that is added at a time.
_GROWTH = 0.35
# Of kernels that are tried in other places: their share at first, tries, and the gain that counts.
_TRIED_SHARE = 0.2
_TRIES = (4, 0)
_GAIN = 0.05
# Starts are so far apart, in sums of their semi-axes.
_APART = (0.4, 1.0)
# Kernels whose equations are solved as a dense matrix.
_DENSE = 2048
# Samples that a search for kernels needs, for each of their numbers and at least: larger lattices are thinned for it.
_NEEDED, _FEW = 32, 1 << 15
# Of larger ones a part is enough to the end.
_MOST = 1 << 18


@dataclass(frozen=True)
class _Limits:
    """Bounds of semi-axes."""

    least: float
    most: float

    @staticmethod
    def of(samples: Samples) -> _Limits:
        longest = max(float(samples.sides().max()), samples.spacing())
        return _Limits(samples.spacing(), 4.0 * longest)

    def kept(self, rows: Floats) -> Floats:
        """Return rows whose semi-axes are within the bounds."""
        own, singular, axes = np.linalg.svd(triangles(rows))
        within = np.clip(singular, 1.0 / self.most, 1.0 / self.least)
        wrong = (within != singular).any(axis=1)
        if wrong.any():
            rows = rows.copy()
            rows[wrong, FRAME] = frame_numbers(within[wrong, :, None] * axes[wrong])
        return rows


class _Descent:
    """Kernels on their way to the least squares of a native fit."""

    def __init__(self, fit: _sheetsplat.EllipsoidFit, rows: Floats, limits: _Limits) -> None:
        self.fit, self.rows, self.limits = fit, limits.kept(rows), limits
        self.objective, self._slope = fit.objective(self.rows)
        self._damping, self._raise = _DAMPING[0], 2.0
        self._blocks: Floats | None = None

    def _ridge(self) -> float:
        """Return the factor of f^2 / 2 in what a step is to make small."""
        return 2.0 * _RIDGE * self.objective / max(1, len(self.rows))

    def _step(self) -> tuple[Floats, float]:
        """Return changes of all kernels, and by how much the model says that the objective falls."""
        if self._blocks is None:
            self._blocks = self.fit.blocks(self.rows)
        own = np.diagonal(self._blocks, axis1=1, axis2=2)
        damping = self._damping * own + _FLOOR * (own.max(axis=0) + np.finfo(np.float64).tiny * 1e20)
        ridge = np.zeros(COLUMNS)
        ridge[VALUE] = self._ridge()
        slope = self._slope + ridge * self.rows
        damped = self._blocks.copy()
        damped[:, np.arange(COLUMNS), np.arange(COLUMNS)] += damping + ridge
        inverse = np.linalg.inv(damped)
        step, left = np.zeros_like(self.rows), -slope
        ahead = np.einsum("nab,nb->na", inverse, left)
        found = wanted = float((left * ahead).sum())
        for _ in range(_INNER):
            if not found > wanted * _LEFT**2:
                break
            product = self.fit.normal(self.rows, ahead) + (damping + ridge) * ahead
            share = found / float((ahead * product).sum())
            step += share * ahead
            left -= share * product
            solved = np.einsum("nab,nb->na", inverse, left)
            last, found = found, float((left * solved).sum())
            ahead = solved + (found / last) * ahead
        model = -slope - left - damping * step
        return step, float(-(slope * step).sum() - 0.5 * (step * model).sum())

    def advance(self) -> float:
        """Try a step, and return the share that the objective fell by."""
        step, foretold = self._step()
        moved = np.linalg.norm(step[:, CENTER], axis=1) / _LARGEST_MOVE
        turned = np.abs(step[:, FRAME]).max(axis=1, initial=0.0) / _LARGEST_CHANGE
        step[:, :VALUE] /= np.maximum(1.0, np.maximum(moved, turned))[:, None]
        rows = self.limits.kept(_sheetsplat.changed_ellipsoids(self.rows, step))
        objective, slope = self.fit.objective(rows)
        grown = (rows[:, VALUE] ** 2 - self.rows[:, VALUE] ** 2).sum()
        fell = self.objective - objective - 0.5 * self._ridge() * float(grown)
        if not fell > 0.0:
            self._damping *= self._raise
            self._raise *= 2.0
            return 0.0
        quality = fell / max(foretold, np.finfo(np.float64).tiny)
        factor = 1.0 - (2.0 * min(quality, 2.0) - 1.0) ** 3
        self._damping = max(_DAMPING[1], self._damping * max(0.2, factor))
        self._raise, self._blocks = 2.0, None
        share = fell / self.objective
        self.rows, self.objective, self._slope = rows, objective, slope
        return share

    def run(self, iterations: int, enough: float, nothing: float) -> _Descent:
        """Take steps until one gains too little, and return self."""
        for _ in range(iterations if len(self.rows) else 0):
            ask()
            if self.objective <= nothing or self._damping > _DAMPING[2]:
                break
            if 0.0 < self.advance() < enough:
                break
        return self


def refine(
    samples: object, kernels: Ellipsoids, iterations: int = _FINAL, *, progress: Progress | None = None
) -> Ellipsoids:
    """Return kernels after steps towards the least squares of what they leave of samples.

    Parameters
    ----------
    samples
        (nk, nj, ni) numbers, NaN where they are missing, or :class:`Samples`, whose base does not count here.
    kernels
        From where the steps begin; their base and falloff stay.
    iterations
        Steps at most; they end where one gains less than a millionth.
    progress
        Called with the finished share; Cancelled where it returns False.
    """
    given = replace(Samples.of(samples), base=kernels.base)
    with asking(progress, "the fit"):
        rows = _unit(kernels, given)
        descent = _Descent(given.fit(kernels.falloff), rows, _Limits.of(given))
        for n in range(iterations):
            note(n / iterations)
            descent.run(1, _ENOUGH[1], _NOTHING * given.weight)
        return _finished(descent.rows, descent.objective, given, kernels.falloff)


def _unit(kernels: Ellipsoids, samples: Samples) -> Floats:
    """Return rows with values in the unit of the fit."""
    rows = kernels.rows.copy()
    rows[:, VALUE] /= samples.scale
    return rows


def _finished(rows: Floats, objective: float, samples: Samples, falloff: float) -> Ellipsoids:
    rows = rows.copy()
    rows[:, VALUE] *= samples.scale
    error = math.sqrt(2.0 * objective / max(samples.weight, np.finfo(np.float64).tiny)) * samples.scale
    return Ellipsoids(rows, samples.base, falloff, error)


def removal_costs(fit: _sheetsplat.EllipsoidFit, rows: Floats) -> Floats:
    """Return by how much the objective grows, at most, where a kernel is taken away and the other values follow.

    At values that are the best for their shapes it is f^2 / (2 (G^-1)_ii), G the sums of products of the kernels' g;
    where these are too many for a dense matrix, f^2 G_ii / 2, what it is when the other values stay.
    """
    if len(rows) > _DENSE:
        return np.asarray(0.5 * rows[:, VALUE] ** 2 * fit.blocks(rows)[:, VALUE, VALUE])
    products = fit.overlaps(rows)
    own = np.diagonal(products) + np.finfo(np.float64).tiny * 1e20
    inverse = np.linalg.inv(products + np.diag(1e-10 * own))
    return np.asarray(0.5 * rows[:, VALUE] ** 2 / np.diagonal(inverse))


def prune(samples: object, kernels: Ellipsoids, bound: float) -> Ellipsoids:
    """Return kernels without those whose removal raises the root mean square error by less than a bound, one by one.

    Parameters
    ----------
    samples, kernels
        As for :func:`refine`. The values are fitted again.
    bound
        In units of the samples.
    """
    given = replace(Samples.of(samples), base=kernels.base)
    limits = _Limits.of(given)
    fit = given.fit(kernels.falloff)
    descent = _Descent(fit, _unit(kernels, given), limits).run(_TOGETHER, _ENOUGH[0], _NOTHING * given.weight)
    most = math.sqrt(2.0 * descent.objective / max(given.weight, 1.0)) + bound / given.scale
    while len(descent.rows):
        rest = np.delete(descent.rows, np.argmin(removal_costs(fit, descent.rows)), axis=0)
        tried = _Descent(fit, rest, limits).run(_TOGETHER, _ENOUGH[0], _NOTHING * given.weight)
        if math.sqrt(2.0 * tried.objective / max(given.weight, 1.0)) > most:
            break
        descent = tried
    return _finished(descent.rows, descent.objective, given, kernels.falloff)


class _Growth:
    """Kernels that grow in number where samples are not met yet."""

    def __init__(self, samples: Samples, falloff: float, seed: int) -> None:
        self.samples, self.falloff = samples, falloff
        self.limits = _Limits.of(samples)
        self.bins = Bins(samples)
        self.random = np.random.default_rng(seed)
        self.fit = samples.fit(falloff)
        self.nothing = _NOTHING * samples.weight

    def descent(self, rows: Floats, iterations: int, enough: float = _ENOUGH[0]) -> _Descent:
        return _Descent(self.fit, rows, self.limits).run(iterations, enough, self.nothing)

    def added(self, rows: Floats, count: int) -> Floats:
        """Return rows with at most `count` more, each fitted to what the given ones leave."""
        ask()
        _, left = self.fit.residual(rows)
        # (Of weights: w (sum - data).)
        weighted = -left.reshape(self.samples.values.shape)
        new = starts(self.bins, weighted, count, float(self.random.uniform(*_APART)), self.falloff)
        if not len(new):
            return rows
        weights = self.samples.weights
        alone = (
            weighted
            if weights is None
            else np.where(weights > 0.0, weighted / np.where(weights > 0.0, weights, 1.0), 0.0)
        )
        fit = self.samples.fit(self.falloff, alone)
        found = _Descent(fit, new, self.limits).run(_ALONE, _ENOUGH[0], self.nothing).rows
        return np.concatenate((rows, found))

    def removed(self, descent: _Descent, count: int) -> _Descent:
        """Return `count` kernels, without those that cost least, half of these at a time."""
        while len(descent.rows) > count:
            away = max(1, (len(descent.rows) - count) // 2)
            cheap = np.argsort(removal_costs(self.fit, descent.rows), kind="stable")[:away]
            descent = self.descent(np.delete(descent.rows, cheap, axis=0), 2 * _TOGETHER)
        return descent

    def is_met(self, descent: _Descent, wanted: float) -> bool:
        """Return whether the objective is at most what is wanted."""
        return descent.objective <= max(wanted, self.nothing)

    def grown(self, rows: Floats, count: int, wanted: float) -> _Descent:
        """Return up to `count` kernels, or as many as the objective calls for."""
        descent = self.descent(rows, _TOGETHER)
        while len(descent.rows) < count and not self.is_met(descent, wanted):
            more = min(count - len(descent.rows), max(4, math.ceil(_GROWTH * len(descent.rows))))
            rows = self.added(descent.rows, more)
            if len(rows) == len(descent.rows):
                break
            descent = self.descent(rows, _TOGETHER)
            note(0.5 * len(descent.rows) / count if math.isfinite(count) else 0.0)
        return descent

    def moved(self, descent: _Descent, tries: int) -> _Descent:
        """Return as many kernels, of which those that do least were tried where most is left."""
        share, count = _TRIED_SHARE, len(descent.rows)
        for n in range(tries if count else 0):
            note(0.5 + 0.4 * n / tries)
            if self.is_met(descent, 0.0):
                break
            more = max(1, int(share * count))
            tried = self.removed(self.descent(self.added(descent.rows, more), 2 * _TOGETHER), count)
            tried.run(2 * _TOGETHER, _ENOUGH[0], self.nothing)
            if tried.objective < descent.objective * (1.0 - _GAIN):
                descent = tried
            elif more == 1:
                break
            else:
                share *= 0.5
        return descent


def greedy(
    samples: object,
    count: int | None = None,
    *,
    max_error: float | None = None,
    seed: int = 0,
    falloff: float = FALLOFF,
    moves: bool = True,
    progress: Progress | None = None,
) -> Ellipsoids:
    """Return few kernels whose sum is near samples; fewer than asked for where these already meet them.

    Of a lattice of more than 2 million samples those of a part of its layers, rows and columns are fitted.

    Parameters
    ----------
    samples
        (nk, nj, ni) numbers, NaN where they are missing, or :class:`Samples`.
    count
        Of kernels, at most.
    max_error
        The root mean square error, in units of the samples, at which no more kernels are added.
    seed
        Of what chance decides: how far apart new kernels begin.
    falloff
        Of the profile.
    moves
        Whether kernels are tried in other places at the end, which takes most of the time.
    progress
        Called with the finished share; Cancelled where it returns False.

    Raises
    ------
    InvalidInput
        For neither a count nor an error, and for samples that cannot be used.
    """
    if count is None and max_error is None:
        raise complain("the fit has no end", "neither a count nor an error", "count or max_error")
    given = Samples.of(samples)
    most = given.values.size if count is None else min(count, given.values.size)
    bound = 0.0 if max_error is None else max_error / given.scale
    with asking(progress, "the fit"):
        first, last = _thinning(given, max(_FEW, _NEEDED * COLUMNS * (count or 0))), _thinning(given, _MOST)
        rows = np.empty((0, COLUMNS))
        # (On the thinner lattice a step takes a fraction of the time.)
        for every in sorted({max(first, last), last}, reverse=True):
            with part(0.5 if every < first else 0.0, 0.9 if every == last else 0.5):
                growth = _Growth(given.every(every), falloff, seed)
                held = max(1, growth.samples.values.size // (_NEEDED * COLUMNS)) if every > last else most
                wanted = 0.5 * bound**2 * growth.samples.weight
                descent = growth.grown(_spread(rows, 1.0 / every), min(most, held), wanted)
                descent = growth.moved(descent, _TRIES[every < first] if moves else 0)
                rows = _spread(descent.rows, float(every))
        rows = _spread(descent.run(_FINAL, _ENOUGH[1], growth.nothing).rows, float(last))
        whole = growth.fit if last == 1 else given.fit(falloff)
        return _finished(rows, whole.residual(rows)[0], given, falloff)


def _thinning(samples: Samples, needed: int) -> int:
    """Return how many samples along each axis of a lattice one may stand for, so that at least `needed` are left."""
    step = 1
    while samples.points is None and samples.values.size >= needed * (step + 1) ** 3:
        step += 1
    return step


def _spread(rows: Floats, factor: float) -> Floats:
    """Return rows with all places times a factor."""
    made = rows.copy()
    made[:, CENTER] *= factor
    made[:, FRAME] /= factor
    return made
