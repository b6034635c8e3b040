/** What the service computes from every sample of what is drawn, and the file of it. */

import type { Figures, Spectra } from "../samples/figures";
import type { Stretch } from "../samples/stretch";
import type { Waiting } from "../service/ranges";

/** Values at one time, by signal; NaN where the sample there has none, and where there is no sample. */
export type Moment = ReadonlyMap<string, number>;

export interface StoredData {
  statistics(names: readonly string[], range: Stretch, waiting: Waiting): Promise<Figures>;
  spectra(names: readonly string[], range: Stretch, waiting: Waiting): Promise<Spectra>;
  /** In the order of the times. */
  values(names: readonly string[], times_s: readonly number[], signal: AbortSignal): Promise<Moment[]>;
  /** Address of the file of every sample of a range; null where the range has none. */
  file(names: readonly string[], range: Stretch): string | null;
  /** What the file is of: "run 12". */
  readonly fileOf: string;
}
