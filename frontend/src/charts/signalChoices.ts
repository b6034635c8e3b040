/** Signals to choose from, by unit; those of one unit first. Pure. */

import type { DerivedSignal } from "../samples/formula";
import { DRAWN, meaningOf } from "../theme/signals";

interface Choices {
  readonly group: string;
  readonly items: { readonly value: string; readonly label: string }[];
}

const WITHOUT_UNIT = "numbers";

/** `first` is the unit that a panel has already, null where any will do; `derived` are offered besides. */
export function signalChoices(first: string | null, derived: readonly DerivedSignal[] = []): Choices[] {
  const all = [...DRAWN, ...derived.map(({ name, unit }) => ({ name, unit, meaning: meaningOf(name) }))];
  const units = [...new Set(all.map(({ unit }) => unit))];
  const ordered = first === null ? units : [first, ...units.filter((unit) => unit !== first)];
  return ordered.map((unit) => ({
    group: unit === "1" ? WITHOUT_UNIT : unit,
    items: all
      .filter((one) => one.unit === unit)
      .map(({ name, meaning }) => ({
        value: name,
        label: `${name}: ${meaning}`,
      })),
  }));
}

/** Those whose name, meaning or unit holds every word that is searched for. */
export function found(choices: readonly Choices[], words: string): Choices[] {
  const wanted = words.toLowerCase().split(/\s+/).filter(Boolean);
  return choices
    .map(({ group, items }) => ({
      group,
      items: items.filter(({ label }) => {
        const text = `${label} ${group}`.toLowerCase();
        return wanted.every((word) => text.includes(word));
      }),
    }))
    .filter(({ items }) => items.length > 0);
}
