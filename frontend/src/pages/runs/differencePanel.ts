/** The panel of a signal's differences: in the looks of the runs that they are of, with the tolerance band. Pure. */

import { markOf, traceOf } from "../../charts/comparedSource";
import type { LimitLine } from "../../charts/decorations";
import type { Angles } from "../../samples/quantity";
import { PALETTE, PANELS, type Panel, readIn, unitOf } from "../../theme/signals";
import { FIELDS } from "../../wire/sample.gen";

/** Those that have a unit: of codes and counts there is no difference that says anything. */
export const SIGNALS = FIELDS.filter(({ unit }) => unit !== "1").map(({ name }) => name);

const GREY = PALETTE[PALETTE.length - 1] as string;
const OTHERS = { quantity: "", factor: 1, decimals: 4, narrowest: 1e-3 };

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
  const like = PANELS.find(({ traces }) => traces.some(({ name }) => name === signal));
  const hue = like?.traces.find(({ name }) => name === signal)?.hue ?? GREY;
  const traces = drawn
    .map((_, n) => ({
      ...traceOf({ name: signal, hue, dashed: false }, n, drawn.length),
      name: `Δ${signal}${markOf(n)}`,
    }))
    .filter((_, n) => drawn[n] !== reference);
  const panel = { ...OTHERS, ...like, title: `Difference of ${signal}`, unit: unitOf(signal), traces };
  return readIn({ ...panel, narrowest: panel.narrowest / 20 }, angles);
}

/** The band, given in SI, as lines of the panel. */
export function bandLines({ title, factor }: Panel, band: number | null): Map<string, LimitLine[]> {
  if (band === null) return new Map();
  const line = (sign: 1 | -1): LimitLine => ({
    value: sign * band * factor,
    label: sign > 0 ? "+ band" : "− band",
    alwaysInSight: true,
  });
  return new Map([[title, [line(1), line(-1)]]]);
}
