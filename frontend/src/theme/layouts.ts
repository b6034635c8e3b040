/** Layouts of the charts: built-in ones, and edits of a person's own ones. Pure. */

import { capital } from "../samples/format";
import { type AngleUnit, FINER, readingOf } from "../samples/quantity";
import { fillText } from "../samples/texts";
import type { ChartLayout, ChartPanel } from "../wire/types";
import { isDrawn, meaningOf, type Panel, type Scale, scaleOf, traceFor, unitOf } from "./signals";
import { TEXTS } from "./texts";

function panel(title: string, signals: readonly string[], over: string | null = null): ChartPanel {
  return { title, signals: [...signals], over, share: 1 };
}

const POSITION_PANEL = panel(TEXTS.position, ["q_ref", "q"]);
const STIFFNESS_PANEL = panel(TEXTS.stiffness, ["S_ref", "S"]);
const FORCE_PANEL = panel(TEXTS.force, ["F_A", "F_B"]);
const VOLTAGE_PANEL = panel(TEXTS.voltage, ["u_A", "u_B"]);
const TOUCH_PANEL = panel(TEXTS.externalForce, ["F_push", "F_ext_hat"]);

function layout(name: string, ...panels: ChartPanel[]): ChartLayout {
  return { version: 1, name, panels };
}

export const STANDARD = layout(
  "Standard",
  POSITION_PANEL,
  STIFFNESS_PANEL,
  FORCE_PANEL,
  VOLTAGE_PANEL,
  TOUCH_PANEL,
);

/** Built-in layouts. */
export const BUILT_IN_LAYOUTS: readonly ChartLayout[] = [
  STANDARD,
  layout(
    "Errors",
    POSITION_PANEL,
    panel(TEXTS.positionError, ["q - q_ref", "q - q_ref_gov"]),
    STIFFNESS_PANEL,
    panel(TEXTS.stiffnessError, ["S - S_ref", "S - S_ref_gov"]),
  ),
  layout(
    "Motors",
    panel(TEXTS.motorPosition, ["theta_A_ref", "theta_A", "theta_B_ref", "theta_B"]),
    panel(TEXTS.motorError, ["theta_A - theta_A_ref", "theta_B - theta_B_ref"]),
    VOLTAGE_PANEL,
    panel(TEXTS.velocity, ["q_dot"]),
  ),
  layout(
    "Forces",
    FORCE_PANEL,
    TOUCH_PANEL,
    panel(TEXTS.forceOverElongationA, ["F_A"], "x_A"),
    panel(TEXTS.forceOverElongationB, ["F_B"], "x_B"),
  ),
  layout("Plane", POSITION_PANEL, STIFFNESS_PANEL, panel(TEXTS.stiffnessOverPosition, ["S_ref", "S"], "q")),
  layout(
    "Timing",
    panel(TEXTS.lateness, ["lateness_s"]),
    panel(TEXTS.missedDeadlines, ["overruns"]),
    panel(TEXTS.modeAndFault, ["mode", "fault"]),
    panel(TEXTS.tuning, ["lam_q", "lam_S"]),
    panel(TEXTS.bankEntry, ["bank_entry"]),
  ),
];

/** Bounds that the service checks too. */
export const MOST = { layouts: 20, panels: 12, signals: 8, title: 40, share: 4 } as const;
export const LEAST_SHARE = 0.5;
const LONGEST_MEANING = 32;

/** Panel to draw, in SI; null if it has no known signal, for instance one stored by another version. */
export function panelOf({ title, signals, over, share }: ChartPanel): Panel | null {
  const known = signals.filter(isDrawn);
  if (known.length === 0 || (over !== null && !isDrawn(over))) return null;
  const traces = known.map((name) => traceFor(name, known));
  const other = over === null ? {} : { over: { name: over, ...scaleOf([over]) } };
  return { title, ...scaleOf(known), traces, ...other, ...(share === 1 ? {} : { share }) };
}

/** Panels of a layout that contain known signals. */
export function panelsOf({ panels }: ChartLayout): Panel[] {
  return panels.map(panelOf).filter((one) => one !== null);
}

/** Converts an axis from SI to the person's unit; an angle has two more decimals in radians than in degrees. */
function scaleIn<S extends Scale>(scale: S, angles: AngleUnit): S {
  const { unit, factor } = readingOf(scale.unit, angles);
  if (factor === 1) return scale;
  return { ...scale, unit, factor, decimals: scale.decimals - FINER, narrowest: scale.narrowest * factor };
}

export function readIn(panel: Panel, angles: AngleUnit): Panel {
  const converted = scaleIn(panel, angles);
  return panel.over === undefined ? converted : { ...converted, over: scaleIn(panel.over, angles) };
}

/** Reason why a panel cannot contain a signal; null if it can. */
function reasonAgainst({ title, signals }: ChartPanel, name: string): string | null {
  const [first] = signals;
  if (first === undefined || unitOf(first) === unitOf(name)) return null;
  return fillText(TEXTS.oneUnit, { signal: name, unit: unitOf(name), title, shown: unitOf(first) });
}

/** Title for a panel of a signal: its meaning up to the first comma if that is short, otherwise its name. */
export function titleFor(name: string, taken: readonly string[]): string {
  const meaning = capital(meaningOf(name).split(/[,:]/)[0] ?? "");
  return unused(meaning !== "" && meaning.length <= LONGEST_MEANING ? meaning : name, taken);
}

/** Returns the name, with a number appended if it is taken. */
export function unused(name: string, taken: readonly string[]): string {
  const short = name.slice(0, MOST.title - 3).trim();
  let candidate = short;
  for (let number = 2; taken.includes(candidate); number += 1) candidate = `${short} ${number}`;
  return candidate;
}

export const PANELS = panelsOf(STANDARD);
export const [POSITION, STIFFNESS, FORCE, VOLTAGE] = PANELS as [Panel, Panel, Panel, Panel, Panel];

/** Edits of a layout: each returns the edited layout, or the reason why it is refused. Pure. */

export type Edited = ChartLayout | string;

const SHARE_STEP = 0.5;

export function withTitle(layout: ChartLayout, place: number, text: string): Edited {
  const title = text.trim();
  if (title === "") return TEXTS.titleMissing;
  if (title.length > MOST.title) return fillText(TEXTS.titleTooLong, { count: MOST.title });
  if (layout.panels.some((panel, index) => index !== place && panel.title === title))
    return fillText(TEXTS.titleTaken, { title });
  return changed(layout, place, { title });
}

export function withSignal(layout: ChartLayout, place: number, name: string): Edited {
  const panel = layout.panels[place] as ChartPanel;
  if (panel.signals.includes(name)) return fillText(TEXTS.signalShown, { title: panel.title, signal: name });
  if (panel.signals.length >= MOST.signals) return fillText(TEXTS.signalsFull, { count: MOST.signals });
  return reasonAgainst(panel, name) ?? changed(layout, place, { signals: [...panel.signals, name] });
}

export function withoutSignal(layout: ChartLayout, place: number, name: string): Edited {
  const panel = layout.panels[place] as ChartPanel;
  if (panel.signals.length === 1) return fillText(TEXTS.lastSignal, { signal: name, title: panel.title });
  return changed(layout, place, { signals: panel.signals.filter((one) => one !== name) });
}

/** Sets the signal of the horizontal axis; null for time. */
export function withOver(layout: ChartLayout, place: number, over: string | null): Edited {
  return requireTimePanel(changed(layout, place, { over }));
}

export function resized(layout: ChartLayout, place: number, steps: number): Edited {
  const { share } = layout.panels[place] as ChartPanel;
  return withShare(layout, place, allowedShare(share + steps * SHARE_STEP));
}

export function withShare(layout: ChartLayout, place: number, share: number): Edited {
  return changed(layout, place, { share });
}

/** The allowed height nearest to `share`, in whole steps. */
export function allowedShare(share: number): number {
  const stepped = Math.round(share / SHARE_STEP) * SHARE_STEP;
  return Math.min(MOST.share, Math.max(LEAST_SHARE, stepped));
}

/** Swaps a panel with the next one of its kind; panels over signals are below those over time. */
export function moved(layout: ChartLayout, place: number, by: 1 | -1): ChartLayout {
  const other = neighbour(layout, place, by);
  if (other === null) return layout;
  const panels = [...layout.panels];
  [panels[place], panels[other]] = [panels[other] as ChartPanel, panels[place] as ChartPanel];
  return { ...layout, panels };
}

/** Index with which a moved panel changes places; null if there is none. */
export function neighbour({ panels }: ChartLayout, place: number, by: 1 | -1): number | null {
  const isPlane = (index: number) => panels[index]?.over !== null;
  for (let index = place + by; index >= 0 && index < panels.length; index += by)
    if (isPlane(index) === isPlane(place)) return index;
  return null;
}

export function withPanel(layout: ChartLayout, name: string): Edited {
  if (layout.panels.length >= MOST.panels) return fillText(TEXTS.panelsFull, { count: MOST.panels });
  const title = titleFor(
    name,
    layout.panels.map((panel) => panel.title),
  );
  return { ...layout, panels: [...layout.panels, { title, signals: [name], over: null, share: 1 }] };
}

export function withoutPanel(layout: ChartLayout, place: number): Edited {
  return requireTimePanel({ ...layout, panels: layout.panels.filter((_, index) => index !== place) });
}

export function renamed(layout: ChartLayout, text: string): Edited {
  const name = text.trim();
  if (name === "") return TEXTS.nameMissing;
  return name.length > MOST.title ? fillText(TEXTS.nameTooLong, { count: MOST.title }) : { ...layout, name };
}

function changed(layout: ChartLayout, place: number, part: Partial<ChartPanel>): ChartLayout {
  return {
    ...layout,
    panels: layout.panels.map((panel, index) => (index === place ? { ...panel, ...part } : panel)),
  };
}

/** Requires a panel over time, because the lowest of them provides the time axis. */
function requireTimePanel(layout: ChartLayout): Edited {
  if (layout.panels.some(({ over }) => over === null)) return layout;
  return TEXTS.timeNeeded;
}
