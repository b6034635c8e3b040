"""``python -m tests.docs.figures [--write] [NAME ...]``: compute the figures of the documents.

Without ``--write`` it prints the figures that differ and returns 1 if there are any. NAME selects computations by a
part of their name.
"""

import argparse
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor

import backend  # noqa: F401  # before numpy: BLAS takes one thread, as in the service
from tests.docs.figures.declared import COMPUTATIONS
from tests.docs.figures.places import Computation, Found, PlaceError, differences, write


def found_of(place: int) -> tuple[Found, float]:
    """Return the result of one computation and its processor time [s]."""
    begun = time.process_time()
    return COMPUTATIONS[place].found(), time.process_time() - begun


def main() -> int:
    """Compute, then print the differences or update the documents. Return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the computed figures into the documents")
    parser.add_argument("names", nargs="*", metavar="NAME", help="computations whose name contains this; all if none")
    options = parser.parse_args()
    chosen = [
        place
        for place, one in enumerate(COMPUTATIONS)
        if not options.names or any(name in one.name for name in options.names)
    ]
    if not chosen:
        print(f"no computation has such a name; known are {', '.join(one.name for one in COMPUTATIONS)}")
        return 2
    all_found: dict[Computation, Found] = {}
    failed = 0
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for place, future in [(place, pool.submit(found_of, place)) for place in chosen]:
            computation = COMPUTATIONS[place]
            try:
                found, seconds = future.result()
            except Exception as error:  # the others continue; this one is reported and counted
                failed += 1
                print(f"{computation.name}: failed: {type(error).__name__}: {error}", flush=True)
                continue
            all_found[computation] = found
            try:
                told = differences(computation, found)
            except PlaceError as error:  # a table with other headings is rewritten, a sentence is not
                told = [str(error)]
            print(f"{computation.name}: {seconds:.1f} s, {len(told)} figures differ", flush=True)
            for each in told:
                print(f"    {each}", flush=True)
            failed += bool(told) and not options.write
    if options.write:
        print("changed:", ", ".join(write(all_found, COMPUTATIONS)) or "nothing")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
