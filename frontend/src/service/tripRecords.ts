/** Which flight record a trip is in, told by its tick and its time: ticks begin anew with each loop process. Pure. */

import { PERIOD_S } from "../wire/sample.gen";
import type { Flight, State } from "../wire/types";
import type { Trip } from "./happenings";

/** Clocks that were compared by a header of whole seconds, and the way of that answer, agree within this [ms]. */
const NEAR_MS = 3000;
const PERIOD_MS = 1000 * PERIOD_S;

/** How long ago a trip was [ms], by a state told since; null where the loop was started anew meanwhile. */
export function ageOf({ fault, starts }: Trip, state: State | null): number | null {
  if (state === null || state.link.starts !== starts || state.tick < fault.tick) return null;
  return (state.tick - fault.tick) * PERIOD_MS;
}

/**
 * The record of a trip at `at_ms` by the service's clock. Trips that follow each other share the record of the first;
 * of another loop's trip at such a tick, which was at another time, it is not.
 */
export function recordOf(flights: readonly Flight[], { fault }: Trip, at_ms: number): Flight | undefined {
  const apart = flights.flatMap((flight) => {
    if (flight.kind !== "trip") return [];
    const after_ms = (fault.tick - flight.tick) * PERIOD_MS;
    if (after_ms < 0 || after_ms > 1000 * flight.after_s) return [];
    return [{ flight, ms: Math.abs(Date.parse(flight.at) + after_ms - at_ms) }];
  });
  return apart.filter(({ ms }) => ms <= NEAR_MS).sort((a, b) => a.ms - b.ms)[0]?.flight;
}
