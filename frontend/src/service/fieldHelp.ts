/** What a box of a form means: as the service declares it, with its unit and what it accepts now. Pure. */

import { type Angles, rangeWithUnit, told } from "../samples/quantity";
import { capital } from "../samples/words";
import type { Setting } from "../wire/types";
import { type Entry, entryOf } from "./glossary";

type Line = readonly [string, string];

export interface Range {
  readonly minimum: number;
  readonly maximum: number;
}

/** The explanation of a declared setting. */
export function settingEntry(setting: Setting, angles: Angles): Entry {
  const { name, symbol, meaning, unit, minimum, maximum, choices, default: usual } = setting;
  const more: Line[] = [];
  if (typeof usual === "number" && minimum != null && maximum != null) {
    more.push(accepted({ minimum, maximum }, unit, angles));
  }
  if (choices != null && choices.length > 0) more.push(["Accepted", choices.join(", ")]);
  if (typeof usual === "number") more.push(["Default", told(usual, unit, angles)]);
  else if (usual !== null && choices != null) more.push(["Default", String(usual)]);
  return {
    kind: "setting",
    name,
    term: symbol || name,
    meaning: capital(meaning),
    unit: unit === "1" ? "" : unit,
    more,
  };
}

/** The explanation of a field of an order, "wall.k_wall"; with what this plant lets it be, where that is known. */
export function fieldEntry(key: string, angles: Angles, range?: Range): Entry | undefined {
  const entry = entryOf(`setting:${key}`);
  if (entry === undefined || range === undefined) return entry;
  return { ...entry, more: [accepted(range, entry.unit ?? "", angles)] };
}

function accepted({ minimum, maximum }: Range, unit: string, angles: Angles): Line {
  return ["Accepted", rangeWithUnit(minimum, maximum, unit, angles)];
}
