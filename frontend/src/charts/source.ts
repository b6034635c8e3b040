/** What a stack of charts draws from, be it the live window or a recording. */

import type { Extent } from "../samples/decimate";
import type { Stretch } from "../samples/stretch";
import type { SampleTable } from "../samples/table";
import type { Panel } from "../theme/signals";

/** The curves of one chart over a stretch, in the unit shown. The arrays are reused by the next call. */
export interface Curves {
  readonly times: Float64Array;
  /** One per trace of the panel. */
  readonly values: readonly Float64Array[];
  readonly extents: readonly Extent[];
}

/** Points of one signal over another in SI, in the order of time. */
export interface Pairs {
  readonly x: Float64Array;
  readonly y: Float64Array;
}

export interface PlotSource {
  /** Where the newest sample is on the time axis [s]. */
  now_s(): number;
  /** The newest sample itself; `now_s` may run a little ahead of it [s]. */
  newest_s(): number;
  /** Where the oldest sample is [s]. */
  first_s(): number;
  /** A number that changes whenever samples are added or replaced. */
  version(): number;
  /** Whether samples within `seen` were added or replaced since `version`. */
  changedWithin(seen: Stretch, version: number): boolean;
  curves(panel: Panel, stretch: Stretch, pixels: number): Curves;
  /** About `points` pairs at most, each of one moment, or of the middles of one bucket where single samples are not here. */
  pairs?(x: string, y: string, seen: Stretch, points: number): Pairs;
  /** The sample at or before an instant, in SI; the middle of a bucket where single samples are not here; NaN where there is none. */
  at(name: string, time_s: number): number;
  /** Whether `at` tells a sample then, not the middle of a bucket; left out where it always does. */
  exactAt?(time_s: number): boolean;
  /** What is known of a stretch, every sample where the source has them; a copy. */
  table(names: readonly string[], stretch: Stretch): SampleTable;
}
