/** The position-stiffness plane on a drawing: SI to pixels and back. Pure. */

import type { Limits } from "../../wire/types";

export interface Plane {
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
/** Room for the scale of tension. */
const RIGHT = 34;
const MARGIN = 0.06;

/** The plane around all that can be reached, with a margin in which the joint can be seen beyond it. */
export function planeOver(limits: Limits, width: number, height: number): Plane {
  const q_end = (1 + MARGIN) * limits.q_trip;
  return {
    width: Math.max(width, LEFT + RIGHT + 1),
    height: Math.max(height, TOP + BOTTOM + 1),
    left: LEFT,
    bottom: BOTTOM,
    q: [-q_end, q_end],
    // from below the stiffness of slack tendons to that of solid springs, with a margin
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

/** The point of the plane under a pixel. */
export function pointAt(plane: Plane, x: number, y: number): { q: number; S: number } {
  const q_share = (x - LEFT) / (plane.width - LEFT - RIGHT);
  const S_share = (plane.height - BOTTOM - y) / (plane.height - TOP - BOTTOM);
  return {
    q: plane.q[0] + q_share * (plane.q[1] - plane.q[0]),
    S: plane.S[0] + S_share * (plane.S[1] - plane.S[0]),
  };
}
