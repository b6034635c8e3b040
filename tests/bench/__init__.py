"""Performance as ratios. Import ``backend`` before numpy, which limits BLAS to one thread as in the service."""

import backend  # noqa: F401  (for its effect on numpy, see above)
