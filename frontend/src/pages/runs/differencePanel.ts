/** The panel of a signal's differences: in the looks of the runs that they are of, with the tolerance band. Pure. */

import { markOf, traceOf } from "../../charts/comparedSource";
import type { LimitLine } from "../../charts/decorations";
import type { Angles } from "../../samples/quantity";
import { readIn } from "../../theme/layouts";
import { type Panel, scaleOf, traceFor } from "../../theme/signals";
import { FIELDS } from "../../wire/sample.gen";

/** Those that have a unit: of codes and counts there is no difference that says anything. */
export const SIGNALS = FIELDS.filter(({ unit }) => unit !== "1").map(({ name }) => name);

/** Differences are small: their axis may be as much finer. */
const FINER = 20;

/** What the difference of a run is called: with the mark that the run has in the curves; null where it has none. */
export function nameOf(signal: string, drawn: readonly number[], run: number): string | null {
  const place = drawn.indexOf(run);
  return place < 0 ? null : `Δ${signal}${markOf(place)}`;
}

/** Of all `drawn` runs but the reference. */
export function differencePanel(
  signal: string,
  drawn: readonly number[],
  reference: number,
  angles: Angles,
): Panel {
  const { hue } = traceFor(signal, []);
  const traces = drawn
    .map((_, n) => ({
      ...traceOf({ name: signal, hue, dashed: false }, n, drawn.length),
      name: `Δ${signal}${markOf(n)}`,
    }))
    .filter((_, n) => drawn[n] !== reference);
  const scale = scaleOf([signal]);
  return readIn(
    { ...scale, narrowest: scale.narrowest / FINER, title: `Difference of ${signal}`, traces },
    angles,
  );
}

/** The band, given in SI, as lines of the panel. */
export function bandLines({ traces, factor }: Panel, band: number | null): readonly LimitLine[] {
  if (band === null) return [];
  const line = (sign: 1 | -1): LimitLine => ({
    of: traces.map(({ name }) => name),
    value: sign * band * factor,
    label: sign > 0 ? "+ band" : "− band",
    alwaysInSight: true,
  });
  return [line(1), line(-1)];
}
