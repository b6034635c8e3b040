/** Looking a word up in the glossary that the service's sources make (`backend/glossary`). */

import { type Entry, GLOSSARY } from "../wire/glossary.gen";
import { COMBINED } from "../wire/sample.gen";
import type { Metric } from "../wire/types";

export type { Entry };

const ENTRIES = Object.values(GLOSSARY);

/** A symbol belongs to what is found first: what is measured, then what tunes, then what a plant is made of. */
const BY_SYMBOL = new Map<string, Entry>();
for (const kind of ["signal", "quantity", "parameter"] as const) {
  for (const entry of ENTRIES.filter((one) => one.kind === kind)) {
    for (const spelled of [entry.name, entry.term]) {
      if (spelled !== "" && !BY_SYMBOL.has(spelled)) BY_SYMBOL.set(spelled, entry);
    }
  }
}

/** The entry of a key like "fault:slack"; undefined for what is not known, as of an older service. */
export function entryOf(key: string): Entry | undefined {
  return GLOSSARY[key];
}

/** The entry of a symbol or a name of the code: "M_s", "λ_q", "theta_A_ref"; primes and numbers tell recordings apart. */
export function symbolEntry(name: string): Entry | undefined {
  return BY_SYMBOL.get(name) ?? BY_SYMBOL.get(name.replace(/[′⁰¹²³⁴-⁹]+/g, ""));
}

/** The entries of a signal; of one that is made of others, those of its parts. */
export function symbolEntries(name: string): readonly (Entry | undefined)[] {
  const own = symbolEntry(name);
  if (own !== undefined) return [own];
  const plain = name.replace(/[′⁰¹²³⁴-⁹]+/g, "");
  const parts = COMBINED.find((one) => one.name === plain)?.terms ?? [];
  return parts.map(({ column }) => symbolEntry(column));
}

/** The entry of a figure: what its result says of it, which stays as it was when it was computed, and its equation. */
export function figureEntry({
  name,
  label,
  unit,
  definition,
}: Pick<Metric, "name" | "label" | "unit" | "definition">): Entry {
  const { equation, source } = entryOf(`figure:${name}`) ?? {};
  const known = { equation: equation ?? "", source: source ?? "" };
  return { kind: "figure", name, term: label, unit: unit === "1" ? "" : unit, meaning: definition, ...known };
}

/** What entries are of, as the glossary's headings, in its order. */
export const KIND_TITLES: Readonly<Record<Entry["kind"], string>> = {
  signal: "Signals",
  quantity: "Control and identification",
  parameter: "Parameters of the plant",
  setting: "Settings and orders",
  figure: "Figures of results",
  outcome: "What a run came to",
  criterion: "Criteria",
  grade: "Grades of a model",
  end: "How a run ended",
  mode: "Modes",
  cause: "Causes of a change of mode",
  fault: "Faults",
  limit: "Limits",
  chain: "Safety chain",
  step: "Steps of the bring-up",
  setup: "Set-up list",
  timing: "Timing of the loop",
};

/** The entries in which every one of the words occurs, wherever; all for no words. */
export function search(text: string): readonly Entry[] {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  if (words.length === 0) return ENTRIES;
  return ENTRIES.filter((entry) => {
    const whole = [entry.term, entry.name, entry.meaning, entry.unit, entry.equation, KIND_TITLES[entry.kind]]
      .concat(...(entry.more ?? []))
      .join(" ")
      .toLowerCase();
    return words.every((word) => whole.includes(word));
  });
}
