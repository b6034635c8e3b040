/** Own sequences of references as rows of an editor, in SI. Pure. */

import { notANumber } from "../../samples/number";

export const SHAPES = ["step", "ramp", "sine"] as const;

/** Text stands for what was typed and is no number: it is shown, and never sent. */
type Typed = number | string;

export interface Segment {
  readonly shape: (typeof SHAPES)[number];
  readonly duration_s: Typed;
  readonly q_ref: Typed;
  readonly S_ref: Typed;
  readonly F_push: Typed;
  /** Of a sine. */
  readonly period_s: Typed;
}

const NEW: Segment = { shape: "step", duration_s: 4, q_ref: 0, S_ref: 10, F_push: 0, period_s: 2 };

const NAMES = {
  duration_s: "time",
  q_ref: "q_ref",
  S_ref: "S_ref",
  F_push: "push",
  period_s: "period",
} as const;

/** Rows of a JSON list of segments; null when it is none. */
export function parseSegments(json: string): Segment[] | null {
  try {
    const items: unknown = JSON.parse(json);
    return Array.isArray(items) ? items.map(segmentOf) : null;
  } catch {
    return null;
  }
}

export function writeSegments(segments: readonly Segment[]): string {
  const items = segments.map(({ shape, duration_s, q_ref, S_ref, F_push, period_s }) => ({
    duration_s,
    q_ref,
    S_ref,
    ...(F_push === 0 ? {} : { F_push }),
    ...(shape === "step" ? {} : { shape }),
    ...(shape === "sine" ? { period_s } : {}),
  }));
  return JSON.stringify(items);
}

/** Why these segments cannot be sent: the first box that holds no number; null when all do, or there are none. */
export function segmentsProblem(json: unknown): string | null {
  for (const [index, segment] of (typeof json === "string" ? (parseSegments(json) ?? []) : []).entries()) {
    const problem = segmentProblem(segment);
    if (problem !== null) return `Segment ${index + 1}, ${problem}.`;
  }
  return null;
}

/** The first box of a segment that holds no number, and what it holds; null when all do. */
export function segmentProblem(segment: Segment): string | null {
  for (const [name, words] of Object.entries(NAMES)) {
    const value = segment[name as keyof typeof NAMES];
    if (typeof value === "string") return `${words}: ${notANumber(value)}`;
  }
  return null;
}

/** Length of all segments [s], of those that say one. */
export function totalOf(segments: readonly Segment[]): number {
  return segments.reduce((sum, { duration_s }) => sum + (typeof duration_s === "number" ? duration_s : 0), 0);
}

/** A further segment like the last one. */
export function further(segments: readonly Segment[]): Segment {
  return segments.at(-1) ?? NEW;
}

function segmentOf(item: Record<string, number | string>): Segment {
  const typed = (name: string, otherwise: number): Typed => item[name] ?? otherwise;
  return {
    shape: SHAPES.find((shape) => shape === item.shape) ?? "step",
    duration_s: typed("duration_s", 4),
    q_ref: typed("q_ref", 0),
    S_ref: typed("S_ref", 10),
    F_push: typed("F_push", 0),
    period_s: typed("period_s", 2),
  };
}
