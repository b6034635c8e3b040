/** The motion of a preview that a λ sets: a step in `lambda` motion, the recovery from a push in `time-optimal`. Pure. */

import type { TuningPreview } from "../../wire/types";

export type LoopName = "position" | "stiffness";

export interface PreviewedMotion {
  readonly kind: "step" | "push";
  /** Time [s]. */
  readonly t: readonly number[];
  /** Progress of the step from 0 to 1, or deviation under the push as a part of the largest one. */
  readonly y: readonly number[];
  /** Where the motion leads to, in the same measure: the new reference, or the band within which the joint is back. */
  readonly target: number;
  /** Time to 90 % of the step, or until the joint is back [s]; null where that does not happen. */
  readonly time_s: number | null;
}

/** Null where λ sets no motion: the trajectory makes the steps, and a push does not move S. */
export function previewedMotion(preview: TuningPreview, loop: LoopName): PreviewedMotion | null {
  if (preview.motion === "lambda") {
    const { t, y, rise_s } = loop === "position" ? preview.step_q : preview.step_S;
    return { kind: "step", t, y, target: 1, time_s: rise_s };
  }
  if (loop === "stiffness") return null;
  const { near, without, rejected } = preview.pushed;
  const { t, off, give, back_s } = rejected ?? without;
  const largest = give > 0 ? give : 1;
  return { kind: "push", t, y: off.map((value) => value / largest), target: near / largest, time_s: back_s };
}
