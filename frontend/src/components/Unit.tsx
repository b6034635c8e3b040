/** The unit of a row, as this person reads it. */

import { readingOf } from "../samples/quantity";
import { useAngles } from "../service/angles";
import { Absent } from "./Absent";

export function Unit({ unit }: { unit: string }) {
  const angles = useAngles();
  return unit === "1" || unit === "" ? <Absent why="it has no unit" /> : readingOf(unit, angles).unit;
}
