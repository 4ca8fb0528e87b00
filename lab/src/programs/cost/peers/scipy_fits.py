"""Fits eq. (5), A exp(-(s (x - x0))^2) + b, to windows of pixels with scipy, as its users call it.

    scipy_fits.py WINDOWS.json FIT...

WINDOWS.json holds {"pixels": [[count, ...], ...], "starts": [[A, x0, s, b], ...]}. For each FIT, a name in FITS below, prints
{FIT: {"centres": [x0 or null, ...], "ns_per_row": median of the fits' times, conversion to float included}}.
"""

import json
import statistics
import sys
import time
import warnings

import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit, minimize


def model(x, a, x0, s, b):
    return a * np.exp(-((s * (x - x0)) ** 2)) + b


def fit_curve(x, y, start):
    return curve_fit(model, x, y, start)[0][1]


def scaling(start):
    """Lengths in units of the spot's width, counts in units of its height: all parameters near one, as the method wants them."""
    a, _, s, _ = start
    return np.array([a, 1 / s, s, a])


def fit_l_bfgs_b(x, y, start):
    scale, height = scaling(start), start[0]

    def cost(scaled):
        return np.sum(((model(x, *(scaled * scale)) - y) / height) ** 2)

    return minimize(cost, start / scale, method="L-BFGS-B").x[1] * scale[1]


FITS = {
    "scipy curve_fit": fit_curve,
    "scipy L-BFGS-B": fit_l_bfgs_b,
}


def run(fit, windows, starts):
    x = np.arange(windows.shape[1], dtype=float)
    centres, times = [], []
    for counts, start in zip(windows, starts):
        began = time.perf_counter_ns()
        try:
            centre = fit(x, counts.astype(float), start)
        except RuntimeError:
            centre = float("nan")
        times.append(time.perf_counter_ns() - began)
        centres.append(centre if np.isfinite(centre) else None)
    return {"centres": centres, "ns_per_row": statistics.median(times)}


def main():
    # A covariance that cannot be estimated leaves the centre as it is.
    warnings.simplefilter("ignore", OptimizeWarning)
    with open(sys.argv[1]) as file:
        given = json.load(file)
    windows = np.array(given["pixels"], dtype=np.uint16)
    starts = np.array(given["starts"])
    json.dump({name: run(FITS[name], windows, starts) for name in sys.argv[2:]}, sys.stdout)


if __name__ == "__main__":
    main()
