"""Statistics on arrays: least squares, noise models, whitening, tests, left-out blocks. No Design, no Log."""
