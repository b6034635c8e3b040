import { useSyncExternalStore } from "react";
import { capital } from "../samples/format";
import { type AngleUnit, formatWithUnit, rangeWithUnit } from "../samples/quantity";
import { type Entry, GLOSSARY } from "../wire/glossary.gen";
import { COMBINED } from "../wire/sample.gen";
import type { Metric, Setting } from "../wire/types";
import { TEXTS } from "./texts";

/** Looking a word up in the glossary that the service's sources make (`backend/glossary`). */

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
  concept: TEXTS.concepts,
  signal: TEXTS.signals,
  quantity: TEXTS.quantities,
  parameter: TEXTS.parameters,
  setting: TEXTS.settings,
  figure: TEXTS.metrics,
  outcome: TEXTS.outcomes,
  criterion: TEXTS.criteria,
  grade: TEXTS.grades,
  end: TEXTS.ends,
  mode: TEXTS.modes,
  cause: TEXTS.causes,
  fault: TEXTS.faults,
  limit: TEXTS.limits,
  chain: TEXTS.chain,
  step: TEXTS.steps,
  setup: TEXTS.setup,
  timing: TEXTS.timing,
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

/**
 * What is being explained, of all the page: one at a time, beside the word that was pointed at, focused or tapped.
 * Pointing waits a moment, so that a pointer on its way opens nothing; focus and tap are answered at once.
 */

const POINTED_MS = 350;
/** So long the pointer may take from the word to its explanation. */
const LEFT_MS = 200;

export interface Explained {
  readonly anchor: HTMLElement;
  readonly entries: readonly Entry[];
  readonly by: "pointer" | "focus" | "tap";
}

let shown: Explained | null = null;
let timer: ReturnType<typeof setTimeout> | undefined;
const listeners = new Set<() => void>();

function become(next: Explained | null): void {
  clearTimeout(timer);
  if (next === shown) return;
  shown = next;
  for (const listener of listeners) listener();
}

export function explain(next: Explained): void {
  clearTimeout(timer);
  if (next.by !== "pointer") become(next);
  else if (shown?.anchor !== next.anchor) timer = setTimeout(become, POINTED_MS, next);
}

/** The pointer has left a word; what focus or tap has opened stays. */
export function pointerLeft(): void {
  clearTimeout(timer);
  if (shown?.by === "pointer") timer = setTimeout(become, LEFT_MS, null);
}

/** The pointer has come to the explanation itself. */
export function keepExplanation(): void {
  clearTimeout(timer);
}

export function closeExplanation(anchor?: HTMLElement): void {
  if (anchor === undefined || shown?.anchor === anchor) become(null);
  else clearTimeout(timer);
}

export function currentExplanation(): Explained | null {
  return shown;
}

function subscribe(listener: () => void): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

export function useExplained(): Explained | null {
  return useSyncExternalStore(subscribe, currentExplanation);
}

/** What a box of a form means: as the service declares it, with its unit and what it accepts now. Pure. */

type Line = readonly [string, string];

interface Range {
  readonly minimum: number;
  readonly maximum: number;
}

/** The explanation of a declared setting. */
export function settingEntry(setting: Setting, angles: AngleUnit): Entry {
  const { name, symbol, meaning, unit, minimum, maximum, choices, default: usual } = setting;
  const more: Line[] = [];
  if (typeof usual === "number" && minimum != null && maximum != null) {
    more.push(accepted({ minimum, maximum }, unit, angles));
  }
  if (choices != null && choices.length > 0) more.push([TEXTS.accepted, choices.join(", ")]);
  if (typeof usual === "number") more.push([TEXTS.default, formatWithUnit(usual, unit, angles)]);
  else if (usual !== null && choices != null) more.push([TEXTS.default, String(usual)]);
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
export function fieldEntry(key: string, angles: AngleUnit, range?: Range): Entry | undefined {
  const entry = entryOf(`setting:${key}`);
  if (entry === undefined || range === undefined) return entry;
  return { ...entry, more: [accepted(range, entry.unit ?? "", angles)] };
}

function accepted({ minimum, maximum }: Range, unit: string, angles: AngleUnit): Line {
  return [TEXTS.accepted, rangeWithUnit(minimum, maximum, unit, angles)];
}
