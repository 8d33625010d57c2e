"""How much more than assumed the points of a frame err, and how much alike: what their residuals show of it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SIGNIFICANT = 2.5  # 1-sigma; a larger spread of one line that chance explains is not counted
FEWEST = 4  # points of a line that show anything beside the line itself
SCORES = np.linspace(-3.0, 3.0, 31)  # 1-sigma about the expected correlation, that are thought possible
MAX_CORRELATION = 0.9  # of neighbouring errors, that is believed either way
# True spread over the stated one. The shipped detector states three times its errors far away, and what is slow in
# them is taken out by the fit: residuals far smaller than stated must not look like errors that are all alike.
LOG_SPREADS = np.linspace(np.log(0.2), 0.0, 17)
AS_STATED = 0.8  # probability that the stated spread is right, the others sharing the rest; our choice


class _Evidence(NamedTuple):
    """Restricted likelihood of the residuals of all lines, for some correlations (C,)."""

    squares: Array  # (C,) of the residuals, whitened, with the fitted line taken out
    log_volume: Array  # (C,) logarithm of the determinants
    degrees: int  # of freedom


def inflation(lines: list[Array], expected: float, sigma: float) -> Array:
    """Factors on 1-sigma (L,) for residuals that are larger or less independent than assumed.

    Neighbouring rows of a detector err together; N points with correlation r between neighbours are worth
    N (1 - r) / (1 + r). One detector saw all lines, so they show its correlation together; how far they show it is
    weighed against what is expected, and the mean variance over what is possible is taken. Errors that are alike but
    smaller than assumed do no harm until they outweigh it; no factor is less than 1.

    Args:
        lines: residuals of each line (N,), in expected 1-sigma, in order along it, less two fitted numbers.
        expected: correlation between neighbours before anything is seen, at most 0.9 either way.
        sigma: how sure that is, 1-sigma; 0: known.

    Source: restricted likelihood of first-order autoregressive errors (Harville 1974), with priors.
    """
    spreads = np.array([_spread(residuals) for residuals in lines])
    scores = SCORES[np.abs(expected + sigma * SCORES) <= MAX_CORRELATION] if sigma else np.zeros(1)
    correlations = expected + sigma * scores
    seen = _evidence([line / spread for line, spread in zip(lines, spreads, strict=True)], correlations)
    if seen.degrees < 1:
        return spreads
    spread = LOG_SPREADS[:, None]
    fit = seen.log_volume + 2 * seen.degrees * spread + seen.squares * np.exp(-2 * spread)
    log_odds = -(fit + scores**2) / 2
    log_odds[:-1] += np.log((1 - AS_STATED) / (len(LOG_SPREADS) - 1))
    log_odds[-1] += np.log(AS_STATED)
    odds = np.exp(log_odds - log_odds.max())
    variances = np.exp(2 * spread) * (1 + correlations) / (1 - correlations)
    return spreads * np.sqrt(max(1.0, float((odds * variances).sum() / odds.sum())))


def _evidence(lines: list[Array], correlations: Array) -> _Evidence:
    squares, volume, degrees = np.zeros(len(correlations)), np.zeros(len(correlations)), 0
    for residuals in lines:
        count = len(residuals)
        if count < FEWEST:
            continue
        columns = np.column_stack([np.ones(count), np.linspace(-1.0, 1.0, count), residuals])
        white = _whitened(columns, correlations)
        products = np.swapaxes(white, 1, 2) @ white  # (C, 3, 3)
        normal, right = products[:, :2, :2], products[:, :2, 2:]
        taken = (right * np.linalg.solve(normal, right)).sum(axis=(1, 2))
        squares += products[:, 2, 2] - taken
        volume += (count - 1) * np.log(1 - correlations**2) + np.linalg.slogdet(normal)[1]
        degrees += count - 2
    return _Evidence(squares, volume, degrees)


def _whitened(columns: Array, correlations: Array) -> Array:
    """Columns (N, k) without what each row has from the one before, for every correlation (C,): (C, N, k)."""
    share = correlations[:, None, None]
    innovation = (columns[1:] - share * columns[:-1]) / np.sqrt(1 - share**2)
    first = np.broadcast_to(columns[:1], (len(correlations), *columns[:1].shape))
    return np.concatenate([first, innovation], axis=1)


def _spread(residuals: Array) -> float:
    degrees = max(len(residuals) - 2, 1)
    chi2 = float(residuals @ residuals) / degrees
    return float(np.sqrt(chi2)) if chi2 > 1 + SIGNIFICANT * np.sqrt(2 / degrees) else 1.0
