/** Changes of a layout: each gives the layout that it leads to, or in words why there is none. Pure. */

import type { ChartLayout, ChartPanel } from "../wire/types";
import { LEAST_SHARE, MOST, titleFor, whyNotIn } from "./layouts";

export type Edited = ChartLayout | string;

const SHARE_STEP = 0.5;

export function withTitle(layout: ChartLayout, place: number, text: string): Edited {
  const title = text.trim();
  if (title === "") return "A panel needs a title.";
  if (title.length > MOST.title) return `A title has ${MOST.title} characters at most.`;
  if (layout.panels.some((panel, index) => index !== place && panel.title === title))
    return `There is a panel “${title}” already; choose another title.`;
  return changed(layout, place, { title });
}

export function withSignal(layout: ChartLayout, place: number, name: string): Edited {
  const panel = layout.panels[place] as ChartPanel;
  if (panel.signals.includes(name)) return `“${panel.title}” shows ${name} already.`;
  if (panel.signals.length >= MOST.signals) return `A panel shows ${MOST.signals} signals at most.`;
  return whyNotIn(panel, name) ?? changed(layout, place, { signals: [...panel.signals, name] });
}

export function withoutSignal(layout: ChartLayout, place: number, name: string): Edited {
  const panel = layout.panels[place] as ChartPanel;
  if (panel.signals.length === 1)
    return `${name} is all that “${panel.title}” shows; remove the panel instead.`;
  return changed(layout, place, { signals: panel.signals.filter((one) => one !== name) });
}

/** Over another signal, or over time for null. */
export function withOver(layout: ChartLayout, place: number, over: string | null): Edited {
  return kept(changed(layout, place, { over }));
}

export function resized(layout: ChartLayout, place: number, steps: number): Edited {
  const { share } = layout.panels[place] as ChartPanel;
  return withShare(layout, place, allowedShare(share + steps * SHARE_STEP));
}

export function withShare(layout: ChartLayout, place: number, share: number): Edited {
  return changed(layout, place, { share });
}

/** The height nearest to `share` that a panel may have, in whole steps. */
export function allowedShare(share: number): number {
  const stepped = Math.round(share / SHARE_STEP) * SHARE_STEP;
  return Math.min(MOST.share, Math.max(LEAST_SHARE, stepped));
}

/** Up or down past the next panel of its kind, as those over signals stand below those over time. */
export function moved(layout: ChartLayout, place: number, by: 1 | -1): ChartLayout {
  const other = neighbour(layout, place, by);
  if (other === null) return layout;
  const panels = [...layout.panels];
  [panels[place], panels[other]] = [panels[other] as ChartPanel, panels[place] as ChartPanel];
  return { ...layout, panels };
}

/** Where a panel goes when it is moved; null where there is nothing to pass. */
export function neighbour({ panels }: ChartLayout, place: number, by: 1 | -1): number | null {
  const isPlane = (index: number) => panels[index]?.over !== null;
  for (let index = place + by; index >= 0 && index < panels.length; index += by)
    if (isPlane(index) === isPlane(place)) return index;
  return null;
}

export function withPanel(layout: ChartLayout, name: string): Edited {
  if (layout.panels.length >= MOST.panels) return `A layout has ${MOST.panels} panels at most.`;
  const title = titleFor(
    name,
    layout.panels.map((panel) => panel.title),
  );
  return { ...layout, panels: [...layout.panels, { title, signals: [name], over: null, share: 1 }] };
}

export function withoutPanel(layout: ChartLayout, place: number): Edited {
  return kept({ ...layout, panels: layout.panels.filter((_, index) => index !== place) });
}

export function renamed(layout: ChartLayout, text: string): Edited {
  const name = text.trim();
  if (name === "") return "A layout needs a name.";
  return name.length > MOST.title ? `A name has ${MOST.title} characters at most.` : { ...layout, name };
}

function changed(layout: ChartLayout, place: number, part: Partial<ChartPanel>): ChartLayout {
  return {
    ...layout,
    panels: layout.panels.map((panel, index) => (index === place ? { ...panel, ...part } : panel)),
  };
}

/** The time axis is that of the lowest panel over time: one has to stay. */
function kept(layout: ChartLayout): Edited {
  if (layout.panels.some(({ over }) => over === null)) return layout;
  return "One panel over time has to stay: its axis is that of all.";
}
