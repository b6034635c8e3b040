/** Where the operator's inputs end and what the plant can bear, as lines of the charts. Pure. */

import type { LimitLine } from "../../charts/decorations";
import { short } from "../../samples/format";
import { type Angles, readingOf } from "../../samples/quantity";
import type { Limits } from "../../wire/types";

const FORCES = ["F_A", "F_B"];
const VOLTAGES = ["u_A", "u_B"];

/** Each with the signals that it limits; none while the limits are not known. */
export function limitLines(limits: Limits | undefined, angles: Angles): readonly LimitLine[] {
  if (limits === undefined) return [];
  const { q_min, q_max, S_min, S_max, F_min, F_max, u_max } = limits;
  const { factor } = readingOf("rad", angles);
  const line = (of: readonly string[], value: number, label: string, alwaysInSight = false): LimitLine => ({
    of,
    value,
    label,
    alwaysInSight,
  });
  return [
    line(["q", "q_ref"], q_min * factor, "lowest q_ref"),
    line(["q", "q_ref"], q_max * factor, "highest q_ref"),
    line(["S", "S_ref"], S_min, "lowest S_ref"),
    line(["S", "S_ref"], S_max, "highest S_ref"),
    line(FORCES, F_min, `slack ${short(F_min)} N`, true),
    line(FORCES, F_max, `limit ${short(F_max)} N`, true),
    line(VOLTAGES, -u_max, `−${short(u_max)} V`, true),
    line(VOLTAGES, u_max, `+${short(u_max)} V`, true),
  ];
}
