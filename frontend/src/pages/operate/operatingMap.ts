/** Draws the map of joint position and stiffness, and converts its pixels to values. */

import type { Surface } from "../../charts/canvas";
import { short } from "../../samples/format";
import { type AngleUnit, formatWithUnit, toSI } from "../../samples/quantity";
import type { SampleWindow } from "../../samples/window";
import { HUES } from "../../theme/signals";
import type { Limits, Prediction, References, State } from "../../wire/types";

/** Converts between SI and pixels of the position-stiffness plane. Pure. */

interface Plane {
  readonly width: number;
  readonly height: number;
  readonly left: number;
  readonly bottom: number;
  readonly q: readonly [number, number];
  readonly S: readonly [number, number];
}

const LEFT = 34;
const BOTTOM = 22;
const TOP = 8;
/** Space for the tension scale [px]. */
const RIGHT = 34;
const MARGIN = 0.06;

/** Returns the plane over the reachable range, with a margin that shows the joint beyond the range. */
export function planeOver(limits: Limits, width: number, height: number): Plane {
  const q_end = (1 + MARGIN) * limits.q_trip;
  return {
    width: Math.max(width, LEFT + RIGHT + 1),
    height: Math.max(height, TOP + BOTTOM + 1),
    left: LEFT,
    bottom: BOTTOM,
    q: [-q_end, q_end],
    // from below the stiffness at the lowest tension to above that of solid springs
    S: [0.6 * (limits.tensions[0]?.S ?? limits.S_min), (limits.tensions.at(-1)?.S ?? limits.S_max) + 0.8],
  };
}

export function xOf(plane: Plane, q: number): number {
  const share = (q - plane.q[0]) / (plane.q[1] - plane.q[0]);
  return LEFT + share * (plane.width - LEFT - RIGHT);
}

export function yOf(plane: Plane, S: number): number {
  const share = (S - plane.S[0]) / (plane.S[1] - plane.S[0]);
  return plane.height - BOTTOM - share * (plane.height - TOP - BOTTOM);
}

/** Returns the point of the plane at a pixel. */
export function pointAt(plane: Plane, x: number, y: number): { q: number; S: number } {
  const q_share = (x - LEFT) / (plane.width - LEFT - RIGHT);
  const S_share = (plane.height - BOTTOM - y) / (plane.height - TOP - BOTTOM);
  return {
    q: plane.q[0] + q_share * (plane.q[1] - plane.q[0]),
    S: plane.S[0] + S_share * (plane.S[1] - plane.S[0]),
  };
}

/** Paints the plane: limits, tensions, operating points of the bank, trail, references and joint. */

const Q_GRID = { deg: [-60, -30, 0, 30, 60], rad: [-1, -0.5, 0, 0.5, 1] } as const;
const S_GRID = [6, 8, 10, 12, 14, 16];
const TRAIL_TICKS = 4000;
const TRAIL_STEP = 40;
const CROSS = 7;
const ENTRY = 5;
const BAND = 0.12;

/** Operating point of the bank; q is null if only its stiffness is known. */
export interface PlaneEntry {
  readonly S: number;
  readonly q: number | null;
}

/** Predicted path of a run, and the lowest and highest position. */
export type PlannedPath = Pick<Prediction, "path" | "q_low" | "q_high">;

export function paintPlane(
  surface: Surface,
  limits: Limits,
  references: State["references"] | undefined,
  window: SampleWindow,
  entries: readonly PlaneEntry[],
  target: References | null,
  angles: AngleUnit,
  planned: PlannedPath | null = null,
): void {
  const { context: pen, width, height, colours } = surface;
  const plane = planeOver(limits, width, height);
  paintRegion(pen, plane, limits, colours);
  paintGrid(pen, plane, angles, colours);
  paintTensions(pen, plane, limits, colours);
  if (planned) paintPlanned(pen, plane, planned, colours);
  paintEntries(pen, plane, entries, colours);
  paintTrail(pen, plane, window, colours);
  if (references && references.S_ref !== null)
    paintCross(pen, plane, { q_ref: references.q_ref, S_ref: references.S_ref }, colours);
  if (target) {
    pen.setLineDash([3, 2]);
    paintCross(pen, plane, target, colours);
    pen.setLineDash([]);
  }
  paintJoint(pen, xOf(plane, window.newest("q")), yOf(plane, window.newest("S")), colours);
}

/** Paints references as a cross; for a target that is not sent, the caller sets a dashed line. */
function paintCross(
  pen: CanvasRenderingContext2D,
  plane: Plane,
  at: References,
  colours: Surface["colours"],
): void {
  const [x, y] = [xOf(plane, at.q_ref), yOf(plane, at.S_ref)];
  pen.strokeStyle = colours.accent;
  pen.lineWidth = 2;
  pen.beginPath();
  pen.moveTo(x - CROSS, y);
  pen.lineTo(x + CROSS, y);
  pen.moveTo(x, y - CROSS);
  pen.lineTo(x, y + CROSS);
  pen.stroke();
}

function paintRegion(
  pen: CanvasRenderingContext2D,
  plane: Plane,
  limits: Limits,
  colours: Surface["colours"],
): void {
  const [slack, solid] = [limits.tensions[0]?.S, limits.tensions.at(-1)?.S];
  if (slack !== undefined && solid !== undefined) {
    const [x, y] = [xOf(plane, -limits.q_trip), yOf(plane, solid)];
    pen.strokeStyle = colours.limit;
    pen.lineWidth = 1;
    pen.setLineDash([3, 3]);
    pen.strokeRect(x, y, xOf(plane, limits.q_trip) - x, yOf(plane, slack) - y);
    pen.setLineDash([]);
  }
  const left = xOf(plane, limits.q_min);
  const top = yOf(plane, limits.S_max);
  pen.fillStyle = colours.accentSoft;
  pen.fillRect(left, top, xOf(plane, limits.q_max) - left, yOf(plane, limits.S_min) - top);
}

/** Paints the tension at rest for each stiffness along the right edge. */
function paintTensions(
  pen: CanvasRenderingContext2D,
  plane: Plane,
  limits: Limits,
  colours: Surface["colours"],
): void {
  pen.fillStyle = colours.axis;
  pen.font = "10px system-ui, sans-serif";
  pen.textAlign = "left";
  for (const { F, S } of limits.tensions) {
    pen.fillText(`${short(F, 2)} N`, xOf(plane, limits.q_trip) + 5, yOf(plane, S) + 3);
  }
}

/** Paints the operating points of the bank as diamonds; hollow on the S axis if the position is unknown. */
function paintEntries(
  pen: CanvasRenderingContext2D,
  plane: Plane,
  entries: readonly PlaneEntry[],
  colours: Surface["colours"],
): void {
  pen.fillStyle = colours.accent;
  pen.strokeStyle = colours.accent;
  pen.lineWidth = 1.5;
  for (const { S, q } of entries) {
    const [x, y] = [q === null ? plane.left : xOf(plane, q), yOf(plane, S)];
    pen.beginPath();
    pen.moveTo(x - ENTRY, y);
    pen.lineTo(x, y - ENTRY);
    pen.lineTo(x + ENTRY, y);
    pen.lineTo(x, y + ENTRY);
    pen.closePath();
    if (q === null) pen.stroke();
    else pen.fill();
  }
}

/** Paints the path of a run as a line, and the range of its positions as a band. */
function paintPlanned(
  pen: CanvasRenderingContext2D,
  plane: Plane,
  { path, q_low, q_high }: PlannedPath,
  colours: Surface["colours"],
): void {
  const [left, right] = [xOf(plane, q_low), xOf(plane, q_high)];
  pen.save();
  pen.fillStyle = colours.drawn(HUES.q);
  pen.globalAlpha = BAND;
  pen.fillRect(left, yOf(plane, plane.S[1]), right - left, yOf(plane, plane.S[0]) - yOf(plane, plane.S[1]));
  pen.restore();
  pen.strokeStyle = colours.text;
  pen.lineWidth = 1.5;
  pen.beginPath();
  for (const { q, S } of path) pen.lineTo(xOf(plane, q), yOf(plane, S));
  pen.stroke();
}

function paintGrid(
  pen: CanvasRenderingContext2D,
  plane: Plane,
  angles: AngleUnit,
  colours: Surface["colours"],
): void {
  const floor = plane.height - plane.bottom;
  pen.strokeStyle = colours.grid;
  pen.fillStyle = colours.axis;
  pen.lineWidth = 1;
  pen.font = "11px system-ui, sans-serif";
  pen.beginPath();
  pen.textAlign = "center";
  for (const angle of Q_GRID[angles]) {
    const x = Math.round(xOf(plane, toSI(angle, "rad", angles))) + 0.5;
    pen.moveTo(x, 4);
    pen.lineTo(x, floor);
    pen.fillText(`${formatWithUnit(angle, "1", angles)}${angles === "deg" ? "°" : ""}`, x, floor + 15);
  }
  pen.textAlign = "right";
  for (const S of S_GRID) {
    const y = Math.round(yOf(plane, S)) + 0.5;
    if (y > floor || y < 4) continue;
    pen.moveTo(plane.left, y);
    pen.lineTo(plane.width - 34, y);
    pen.fillText(String(S), plane.left - 6, y + 4);
  }
  pen.stroke();
}

function paintTrail(
  pen: CanvasRenderingContext2D,
  plane: Plane,
  window: SampleWindow,
  colours: Surface["colours"],
): void {
  pen.strokeStyle = colours.limit;
  pen.lineWidth = 1;
  pen.beginPath();
  const from = Math.max(window.startTick, window.endTick - TRAIL_TICKS);
  for (let tick = from - (from % TRAIL_STEP) + TRAIL_STEP; tick < window.endTick; tick += TRAIL_STEP) {
    const [q, S] = [window.at("q", tick), window.at("S", tick)];
    if (Number.isFinite(q) && Number.isFinite(S)) pen.lineTo(xOf(plane, q), yOf(plane, S));
  }
  pen.stroke();
}

function paintJoint(pen: CanvasRenderingContext2D, x: number, y: number, colours: Surface["colours"]): void {
  if (!Number.isFinite(x) || !Number.isFinite(y)) return;
  pen.fillStyle = colours.drawn(HUES.q);
  pen.strokeStyle = colours.panel;
  pen.lineWidth = 1.5;
  pen.beginPath();
  pen.arc(x, y, 5, 0, 2 * Math.PI);
  pen.fill();
  pen.stroke();
}
