/** Signals to choose from, by unit; those of one unit first. Pure. */

import { DRAWN } from "../theme/signals";

interface Choices {
  readonly group: string;
  readonly items: { readonly value: string; readonly label: string }[];
}

const WITHOUT_UNIT = "numbers";

/** `first` is the unit that a panel has already; null where any will do. */
export function signalChoices(first: string | null): Choices[] {
  const units = [...new Set(DRAWN.map(({ unit }) => unit))];
  const ordered = first === null ? units : [first, ...units.filter((unit) => unit !== first)];
  return ordered.map((unit) => ({
    group: unit === "1" ? WITHOUT_UNIT : unit,
    items: DRAWN.filter((one) => one.unit === unit).map(({ name, meaning }) => ({
      value: name,
      label: `${name}: ${meaning}`,
    })),
  }));
}
