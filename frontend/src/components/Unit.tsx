/** The unit of a row, as this person reads it. */

import { readingNear } from "../samples/quantity";
import { useAngles } from "../service/angles";
import { Absent } from "./Absent";

/** `near` is the figure of the row in SI, whose prefix the unit takes. */
export function Unit({ unit, near = 1 }: { unit: string; near?: number | undefined }) {
  const angles = useAngles();
  return unit === "1" || unit === "" ? <Absent why="it has no unit" /> : readingNear(near, unit, angles).unit;
}
