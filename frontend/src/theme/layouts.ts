/** Layouts of the charts: which panels, with which signals. Some come with the page, each person may have others. Pure. */

import { type Angles, FINER, readingOf } from "../samples/quantity";
import { capital } from "../samples/words";
import type { ChartLayout, ChartPanel } from "../wire/types";
import { isDrawn, meaningOf, type Panel, type Scale, scaleOf, traceFor, unitOf } from "./signals";

function panel(title: string, signals: readonly string[], over: string | null = null): ChartPanel {
  return { title, signals: [...signals], over, share: 1 };
}

const POSITION_PANEL = panel("Joint position", ["q_ref", "q"]);
const STIFFNESS_PANEL = panel("Joint stiffness", ["S_ref", "S"]);
const FORCE_PANEL = panel("Tendon force", ["F_A", "F_B"]);
const VOLTAGE_PANEL = panel("Motor voltage", ["u_A", "u_B"]);
const TOUCH_PANEL = panel("Outside force", ["F_push", "F_ext_hat"]);

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

/** What comes with the page. */
export const READY: readonly ChartLayout[] = [
  STANDARD,
  layout(
    "Errors",
    POSITION_PANEL,
    panel("Position error", ["q - q_ref", "q - q_ref_gov"]),
    STIFFNESS_PANEL,
    panel("Stiffness error", ["S - S_ref", "S - S_ref_gov"]),
  ),
  layout(
    "Motors",
    panel("Motor position", ["theta_A_ref", "theta_A", "theta_B_ref", "theta_B"]),
    panel("Motor error", ["theta_A - theta_A_ref", "theta_B - theta_B_ref"]),
    VOLTAGE_PANEL,
    panel("Joint velocity", ["q_dot"]),
  ),
  layout(
    "Forces",
    FORCE_PANEL,
    TOUCH_PANEL,
    panel("Force over elongation A", ["F_A"], "x_A"),
    panel("Force over elongation B", ["F_B"], "x_B"),
  ),
  layout("Plane", POSITION_PANEL, STIFFNESS_PANEL, panel("Stiffness over position", ["S_ref", "S"], "q")),
  layout(
    "Timing",
    panel("Lateness", ["lateness_s"]),
    panel("Missed deadlines", ["overruns"]),
    panel("Mode and fault", ["mode", "fault"]),
    panel("Tuning", ["lam_q", "lam_S"]),
    panel("Bank entry", ["bank_entry"]),
  ),
];

/** Bounds that the service has too. */
export const MOST = { layouts: 20, panels: 12, signals: 8, title: 40, share: 4 } as const;
export const LEAST_SHARE = 0.5;
const LONGEST_MEANING = 32;

/** The panel in SI, as it is drawn; null where nothing of it is known, as after another version has kept it. */
export function panelOf({ title, signals, over, share }: ChartPanel): Panel | null {
  const known = signals.filter(isDrawn);
  if (known.length === 0 || (over !== null && !isDrawn(over))) return null;
  const traces = known.map((name) => traceFor(name, known));
  const other = over === null ? {} : { over: { name: over, ...scaleOf([over]) } };
  return { title, ...scaleOf(known), traces, ...other, ...(share === 1 ? {} : { share }) };
}

/** The panels of a layout that have something to draw. */
export function panelsOf({ panels }: ChartLayout): Panel[] {
  return panels.map(panelOf).filter((one) => one !== null);
}

/** An axis in SI in the unit in which a person reads it; an angle of two decimals in degrees has four in radians. */
function scaleIn<S extends Scale>(scale: S, angles: Angles): S {
  const { unit, factor } = readingOf(scale.unit, angles);
  if (factor === 1) return scale;
  return { ...scale, unit, factor, decimals: scale.decimals - FINER, narrowest: scale.narrowest * factor };
}

export function readIn(panel: Panel, angles: Angles): Panel {
  const read = scaleIn(panel, angles);
  return panel.over === undefined ? read : { ...read, over: scaleIn(panel.over, angles) };
}

/** Why a signal cannot stand in this panel; null where it can. */
export function whyNotIn({ title, signals }: ChartPanel, name: string): string | null {
  const [first] = signals;
  if (first === undefined || unitOf(first) === unitOf(name)) return null;
  return `${name} is in ${unitOf(name)}, “${title}” shows ${unitOf(first)}: one panel has one unit. Add a panel for it.`;
}

/** A title for a panel of this signal: what it means, as far as its first comma, where that is short. */
export function titleFor(name: string, taken: readonly string[]): string {
  const meaning = capital(meaningOf(name).split(/[,:]/)[0] ?? "");
  return unused(meaning !== "" && meaning.length <= LONGEST_MEANING ? meaning : name, taken);
}

/** The name with a number behind it where it is taken. */
export function unused(name: string, taken: readonly string[]): string {
  const short = name.slice(0, MOST.title - 3).trim();
  let wanted = short;
  for (let number = 2; taken.includes(wanted); number += 1) wanted = `${short} ${number}`;
  return wanted;
}

export const PANELS = panelsOf(STANDARD);
export const [POSITION, STIFFNESS, FORCE, VOLTAGE] = PANELS as [Panel, Panel, Panel, Panel, Panel];
