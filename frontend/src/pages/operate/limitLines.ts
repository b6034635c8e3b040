/** Where the operator's inputs end and what the plant can bear, as lines of the charts. Pure. */

import type { LimitLine } from "../../charts/decorations";
import { short } from "../../samples/format";
import { type Angles, readingOf } from "../../samples/quantity";
import { FORCE, POSITION, STIFFNESS, VOLTAGE } from "../../theme/signals";
import type { Limits } from "../../wire/types";

/** Lines by the title of their panel; none while the limits are not known. */
export function limitLines(
  limits: Limits | undefined,
  angles: Angles,
): ReadonlyMap<string, readonly LimitLine[]> {
  if (limits === undefined) return new Map();
  const { q_min, q_max, S_min, S_max, F_min, F_max, u_max } = limits;
  const { factor } = readingOf("rad", angles);
  const line = (value: number, label: string, alwaysInSight = false): LimitLine => ({
    value,
    label,
    alwaysInSight,
  });
  return new Map<string, readonly LimitLine[]>([
    [POSITION.title, [line(q_min * factor, "lowest q_ref"), line(q_max * factor, "highest q_ref")]],
    [STIFFNESS.title, [line(S_min, "lowest S_ref"), line(S_max, "highest S_ref")]],
    [
      FORCE.title,
      [line(F_min, `slack ${short(F_min)} N`, true), line(F_max, `limit ${short(F_max)} N`, true)],
    ],
    [VOLTAGE.title, [line(-u_max, `−${short(u_max)} V`, true), line(u_max, `+${short(u_max)} V`, true)]],
  ]);
}
