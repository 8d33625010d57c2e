"""Noise inflation from the dispersion and correlation of a frame's residuals."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SIGNIFICANT_SIGMA = 2.5  # a dispersion within so many 1-sigma of chance is not counted
MIN_POINTS = 4  # of a line whose residuals show anything beside the fitted line
# Prior of the correlation of neighbouring points' errors. The shipped detector's residuals on rendered frames have 0.2
# nearer than 100 m, -0.5 from 100 to 200 m, 0.4 to 0.7 beyond.
CORRELATION, CORRELATION_SIGMA = 0.2, 0.3
MAX_CORRELATION = 0.9  # either way
SCORES = np.linspace(-3.0, 3.0, 31)  # grid of correlations, in 1-sigma of the prior
# Grid of the true dispersion over the stated one. The shipped detector states three times its errors far away, and the
# fit removes their slow part: residuals far smaller than stated must not look like correlated errors.
LOG_DISPERSIONS = np.linspace(np.log(0.2), 0.0, 17)
AS_STATED = 0.8  # prior probability that the stated dispersion is right, the others sharing the rest; our choice


class _Likelihood(NamedTuple):
    """Restricted likelihood of the residuals of all lines, for some correlations (C,)."""

    squares: Array  # (C,) of the residuals, whitened, with the fitted line taken out
    log_volume: Array  # (C,) logarithm of the determinants
    degrees: int  # of freedom


def noise_inflation(lines: list[Array], prior_correlation: float, prior_sigma: float) -> Array:
    """Factors on 1-sigma (L,) for residuals that are larger or more correlated than assumed.

    N points with correlation r between neighbours carry the information of N (1 - r) / (1 + r) independent ones. All
    lines come from one detector and share r. The factor is the posterior mean of the variance over a grid of
    correlations and dispersions. No factor is less than 1.

    Args:
        lines: normalised residuals (N,) of each line, in order along it, less two fitted numbers.
        prior_correlation: of neighbouring residuals, at most 0.9 either way.
        prior_sigma: 1-sigma of it; 0: known.

    Source: restricted likelihood of first-order autoregressive errors (Harville 1974), with priors.
    """
    dispersions = np.array([_dispersion(residuals) for residuals in lines])
    scores = SCORES[np.abs(prior_correlation + prior_sigma * SCORES) <= MAX_CORRELATION] if prior_sigma else np.zeros(1)
    correlations = prior_correlation + prior_sigma * scores
    normalised = [line / dispersion for line, dispersion in zip(lines, dispersions, strict=True)]
    likelihood = _likelihood(normalised, correlations)
    if likelihood.degrees < 1:
        return dispersions
    log_dispersion = LOG_DISPERSIONS[:, None]
    fit = (
        likelihood.log_volume
        + 2 * likelihood.degrees * log_dispersion
        + likelihood.squares * np.exp(-2 * log_dispersion)
    )
    log_odds = -(fit + scores**2) / 2
    log_odds[:-1] += np.log((1 - AS_STATED) / (len(LOG_DISPERSIONS) - 1))
    log_odds[-1] += np.log(AS_STATED)
    odds = np.exp(log_odds - log_odds.max())
    variances = np.exp(2 * log_dispersion) * (1 + correlations) / (1 - correlations)
    return dispersions * np.sqrt(max(1.0, float((odds * variances).sum() / odds.sum())))


def _likelihood(lines: list[Array], correlations: Array) -> _Likelihood:
    squares, volume, degrees = np.zeros(len(correlations)), np.zeros(len(correlations)), 0
    for residuals in lines:
        count = len(residuals)
        if count < MIN_POINTS:
            continue
        columns = np.column_stack([np.ones(count), np.linspace(-1.0, 1.0, count), residuals])
        white = _whiten(columns, correlations)
        products = np.swapaxes(white, 1, 2) @ white  # (C, 3, 3)
        normal, right = products[:, :2, :2], products[:, :2, 2:]
        explained = (right * np.linalg.solve(normal, right)).sum(axis=(1, 2))
        squares += products[:, 2, 2] - explained
        volume += (count - 1) * np.log(1 - correlations**2) + np.linalg.slogdet(normal)[1]
        degrees += count - 2
    return _Likelihood(squares, volume, degrees)


def _whiten(columns: Array, correlations: Array) -> Array:
    """Columns (N, k) without what each row has from the one before, for every correlation (C,): (C, N, k)."""
    share = correlations[:, None, None]
    innovation = (columns[1:] - share * columns[:-1]) / np.sqrt(1 - share**2)
    first = np.broadcast_to(columns[:1], (len(correlations), *columns[:1].shape))
    return np.concatenate([first, innovation], axis=1)


def _dispersion(residuals: Array) -> float:
    degrees = max(len(residuals) - 2, 1)
    chi2 = float(residuals @ residuals) / degrees
    return float(np.sqrt(chi2)) if chi2 > 1 + SIGNIFICANT_SIGMA * np.sqrt(2 / degrees) else 1.0
