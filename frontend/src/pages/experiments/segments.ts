/** Own sequences of references as rows of an editor; degrees here, SI on the wire. Pure. */

import { DEGREES } from "../../theme/signals";

export const SHAPES = ["step", "ramp", "sine"] as const;

export interface Segment {
  readonly shape: (typeof SHAPES)[number];
  readonly duration_s: number;
  readonly q_ref_deg: number;
  readonly S_ref: number;
  readonly F_push: number;
  /** Of a sine. */
  readonly period_s: number;
}

const NEW: Segment = { shape: "step", duration_s: 4, q_ref_deg: 0, S_ref: 10, F_push: 0, period_s: 2 };

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
  const items = segments.map(({ shape, duration_s, q_ref_deg, S_ref, F_push, period_s }) => ({
    duration_s,
    q_ref: q_ref_deg / DEGREES,
    S_ref,
    ...(F_push === 0 ? {} : { F_push }),
    ...(shape === "step" ? {} : { shape }),
    ...(shape === "sine" ? { period_s } : {}),
  }));
  return JSON.stringify(items);
}

/** A further segment like the last one. */
export function further(segments: readonly Segment[]): Segment {
  return segments.at(-1) ?? NEW;
}

function segmentOf(item: Record<string, number | string>): Segment {
  const number = (name: string, otherwise: number) => {
    const value = item[name];
    return typeof value === "number" ? value : otherwise;
  };
  return {
    shape: SHAPES.find((shape) => shape === item.shape) ?? "step",
    duration_s: number("duration_s", NEW.duration_s),
    q_ref_deg: Number((number("q_ref", 0) * DEGREES).toFixed(2)),
    S_ref: number("S_ref", NEW.S_ref),
    F_push: number("F_push", 0),
    period_s: number("period_s", NEW.period_s),
  };
}
