import { useSyncExternalStore } from "react";
import { capital } from "../samples/format";
import { type AngleUnit, formatWithUnit, rangeWithUnit } from "../samples/quantity";
import { type Entry, GLOSSARY } from "../wire/glossary.gen";
import { COMBINED } from "../wire/sample.gen";
import type { Metric, Setting } from "../wire/types";
import { TEXTS } from "./texts";

/** Finds terms in the glossary, which is generated from `backend/glossary`. */

export type { Entry };

const ENTRIES = Object.values(GLOSSARY);

/** Entries by symbol; the first match applies: signals, then quantities, then parameters of the plant. */
const BY_SYMBOL = new Map<string, Entry>();
for (const kind of ["signal", "quantity", "parameter"] as const) {
  for (const entry of ENTRIES.filter((one) => one.kind === kind)) {
    for (const spelled of [entry.name, entry.term]) {
      if (spelled !== "" && !BY_SYMBOL.has(spelled)) BY_SYMBOL.set(spelled, entry);
    }
  }
}

/** Returns the entry of a key such as "fault:slack"; undefined for an unknown key. */
export function entryOf(key: string): Entry | undefined {
  return GLOSSARY[key];
}

/** Returns the entry of a symbol or name: "M_s", "λ_q", "theta_A_ref"; without primes and superscripts of recordings. */
export function symbolEntry(name: string): Entry | undefined {
  return BY_SYMBOL.get(name) ?? BY_SYMBOL.get(name.replace(/[′⁰¹²³⁴-⁹]+/g, ""));
}

/** Returns the entries of a signal; for a combined signal, those of its terms. */
export function symbolEntries(name: string): readonly (Entry | undefined)[] {
  const own = symbolEntry(name);
  if (own !== undefined) return [own];
  const plain = name.replace(/[′⁰¹²³⁴-⁹]+/g, "");
  const parts = COMBINED.find((one) => one.name === plain)?.terms ?? [];
  return parts.map(({ column }) => symbolEntry(column));
}

/** Returns the entry of a metric: its stored definition, and the equation of the glossary. */
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

/** Headings of the glossary by kind of entry, in its order. */
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

/** Returns the entries that contain every word; all entries without words. */
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
 * The page shows one explanation at a time, next to the term under the pointer, focused or tapped. The pointer opens it
 * after a delay, so that a passing pointer opens nothing; focus and tap open it at once.
 */

const POINTED_MS = 350;
/** Longest time of the pointer between the term and its explanation [ms]. */
const LEFT_MS = 200;

export interface Explained {
  readonly anchor: HTMLElement;
  readonly entries: readonly Entry[];
  readonly by: "pointer" | "focus" | "tap";
}

let shown: Explained | null = null;
let timer: ReturnType<typeof setTimeout> | undefined;
const listeners = new Set<() => void>();

function setShown(next: Explained | null): void {
  clearTimeout(timer);
  if (next === shown) return;
  shown = next;
  for (const listener of listeners) listener();
}

export function explain(next: Explained): void {
  clearTimeout(timer);
  if (next.by !== "pointer") setShown(next);
  else if (shown?.anchor !== next.anchor) timer = setTimeout(setShown, POINTED_MS, next);
}

/** Closes an explanation that the pointer opened, after a delay; one opened by focus or tap remains. */
export function pointerLeft(): void {
  clearTimeout(timer);
  if (shown?.by === "pointer") timer = setTimeout(setShown, LEFT_MS, null);
}

/** Cancels the closing, because the pointer is on the explanation. */
export function keepExplanation(): void {
  clearTimeout(timer);
}

export function closeExplanation(anchor?: HTMLElement): void {
  if (anchor === undefined || shown?.anchor === anchor) setShown(null);
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

/** A name and its value in an explanation. */

type Line = readonly [string, string];

interface Range {
  readonly minimum: number;
  readonly maximum: number;
}

/** Returns the explanation of a declared setting. */
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

/** Returns the explanation of a field of a command, "wall.k_wall", with its range if known. */
export function fieldEntry(key: string, angles: AngleUnit, range?: Range): Entry | undefined {
  const entry = entryOf(`setting:${key}`);
  if (entry === undefined || range === undefined) return entry;
  return { ...entry, more: [accepted(range, entry.unit ?? "", angles)] };
}

function accepted({ minimum, maximum }: Range, unit: string, angles: AngleUnit): Line {
  return [TEXTS.accepted, rangeWithUnit(minimum, maximum, unit, angles)];
}
