/** Margins of the motor loop in words. Pure. */

import { fixed } from "../samples/format";
import type { MotorMargins } from "../wire/types";

/** A gain that may not fall is told with the one that it may rise to: the loop is lost at either end. */
export function marginsText({
  M_s,
  gain_margin,
  gain_reduction_margin,
  phase_margin_deg,
}: MotorMargins): string {
  const up = gain_margin === null ? "any" : `×${fixed(gain_margin, 1)}`;
  const gain =
    gain_reduction_margin === null ? `up to ${up}` : `×${fixed(gain_reduction_margin, 3)} to ${up}`;
  const phase = phase_margin_deg === null ? "any" : `${fixed(phase_margin_deg, 0)}°`;
  return `M_s ${fixed(M_s, 3)}, gain ${gain}, phase margin ${phase}`;
}
