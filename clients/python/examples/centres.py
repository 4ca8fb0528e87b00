"""Finds the centres of five rows in a numpy array. The last row has no spot."""

import numpy as np

import slitrange

# Rows of 1024 pixels: a gaussian spot of 2000 counts, 10 electrons a count, read noise of 5 counts.
random = np.random.default_rng(1)
true_px = 512 + 10 * random.random(5)
light = 2000 * np.exp(-0.5 * ((np.arange(1024) - true_px[:, np.newaxis]) / 7.7) ** 2)
light[4] = 0
rows = np.rint(random.poisson(10 * light) / 10 + 300 + random.normal(0, 5, light.shape)).astype(np.uint16)

found = slitrange.centres(rows, geometry=slitrange.Geometry.of_pixels(1024, electrons_per_count=10))
for true, centre, u, fault in zip(true_px, found.centre_px, found.u_px, found.fault, strict=True):
    print(f"true {true:.4f} px, found {centre:.4f} px, u {u:.4f} px {fault}")
