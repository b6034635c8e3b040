"""All computations, in the order in which their rows are printed."""

from tests.docs.figures import (
    experiments_page,
    friction,
    identification_page,
    outside_force,
    paper_experiments,
    rejection_page,
    wall,
)

COMPUTATIONS = (
    *identification_page.computations(),
    *paper_experiments.computations(),
    *friction.computations(),
    *wall.computations(),
    *outside_force.computations(),
    *experiments_page.computations(),
    *rejection_page.computations(),
)
