import { TEXTS } from "./texts";

/** Document of an experiment in the format of the service, with changes by place. Pure. */

/** A value in SI, or an expression of the experiment's settings. */
export type Value = number | string | boolean;
export type Place = readonly (number | string)[];

export interface Part {
  readonly do: string;
  readonly [name: string]: Value | Part[] | Readonly<Record<string, Part[]>> | undefined;
}

interface Phase {
  readonly name: string;
  readonly title: string;
  readonly parts: readonly Part[];
}

export interface Bound {
  readonly figure: string;
  readonly name?: string;
  readonly title?: string;
  readonly below?: number | string;
  readonly above?: number | string;
}

export interface Document {
  readonly format: number;
  readonly name: string;
  readonly title: string;
  readonly description?: string;
  readonly phases: readonly Phase[];
  readonly criteria?: readonly Bound[];
  readonly [other: string]: unknown;
}

export const SAMPLE: Document = {
  format: 1,
  name: "mine",
  title: TEXTS.sampleTitle,
  phases: [
    {
      name: "sequence",
      title: TEXTS.samplePhase,
      parts: [
        { do: "step", q_ref: 0, S_ref: 10, duration_s: 2 },
        { do: "ramp", q_ref: 0.5, duration_s: 2 },
        { do: "hold", duration_s: 2 },
      ],
    },
  ],
  criteria: [{ figure: "min_tension_N", above: 2, title: TEXTS.sampleCriterion }],
};

/** Returns data as a document if the editor can show it; the service reports other errors, with their place. */
export function asDocument(read: unknown): Document | null {
  const found = read as Document | null;
  const isOne =
    typeof found === "object" &&
    found !== null &&
    Array.isArray(found.phases) &&
    found.phases.every(
      (phase) =>
        typeof phase === "object" &&
        phase !== null &&
        Array.isArray(phase.parts) &&
        phase.parts.every(isPart),
    );
  return isOne ? found : null;
}

function isPart(part: unknown): boolean {
  if (typeof part !== "object" || part === null || typeof (part as Part).do !== "string") return false;
  return innerOf(part as Part).every(([, inner]) => Array.isArray(inner) && inner.every(isPart));
}

/** Parses a document in JSON; null for any other text, which the service parses. */
export function documentIn(text: string): Document | null {
  try {
    return asDocument(JSON.parse(text));
  } catch {
    return null;
  }
}

/** Formats a document as JSON, which is valid YAML, with one line for each part. */
export function writeDocument(document: Document): string {
  return `${write(document, "")}\n`;
}

function write(value: unknown, indent: string): string {
  const flat = JSON.stringify(value);
  if (flat.length + indent.length <= 100 && !/"(phases|parts)":/.test(flat)) return flat;
  const deeper = `${indent}  `;
  if (Array.isArray(value)) {
    return `[\n${value.map((one) => deeper + write(one, deeper)).join(",\n")}\n${indent}]`;
  }
  if (typeof value !== "object" || value === null) return flat;
  const entries = Object.entries(value).filter(([, one]) => one !== undefined);
  return `{\n${entries.map(([name, one]) => `${deeper}${JSON.stringify(name)}: ${write(one, deeper)}`).join(",\n")}\n${indent}}`;
}

/** Returns the lists of parts within a part, each with its place. */
export function innerOf(part: Part): [Place, readonly Part[]][] {
  if (Array.isArray(part.parts)) return [[["parts"], part.parts]];
  if (part.do === "choose" && typeof part.of === "object") {
    return Object.entries(part.of as Record<string, Part[]>).map(([name, parts]) => [["of", name], parts]);
  }
  return [];
}

type Tree = Record<string | number, unknown>;

/** Returns the value at a place. */
function at(document: unknown, place: Place): unknown {
  return place.reduce((here, name) => (here as Tree | undefined)?.[name], document);
}

/** Returns a copy with another value at a place. */
function withAt<T>(document: T, place: Place, next: unknown): T {
  const [name, ...rest] = place;
  if (name === undefined) return next as T;
  const here = document as Tree;
  const inner = withAt(here[name], rest, next);
  return (Array.isArray(here) ? here.with(Number(name), inner) : { ...here, [name]: inner }) as T;
}

export function replaced(document: Document, place: Place, next: unknown): Document {
  return withAt(document, place, next);
}

/** Returns the place of the list that contains an item, and the index of the item. */
function within(place: Place): [Place, number] {
  return [place.slice(0, -1), Number(place.at(-1))];
}

export function inserted(document: Document, place: Place, item: unknown): Document {
  const [list, index] = within(place);
  return withAt(document, list, (at(document, list) as unknown[]).toSpliced(index, 0, item));
}

export function removed(document: Document, place: Place): Document {
  const [list, index] = within(place);
  return withAt(document, list, (at(document, list) as unknown[]).toSpliced(index, 1));
}

/** Whether one place is within another, or equal to it. */
function lies(place: Place, around: Place): boolean {
  return around.every((name, index) => place[index] === name);
}

/**
 * Moves a part before the item at another place, in any list; returns the document and the new place. A part does not
 * move into itself.
 */
export function moved(document: Document, from: Place, to: Place): [Document, Place] {
  if (lies(to, from)) return [document, from];
  const item = at(document, from);
  const [list, index] = within(from);
  const without = removed(document, from);
  const behind = lies(to, list) && Number(to[list.length]) > index;
  const target = behind ? to.with(list.length, Number(to[list.length]) - 1) : to;
  return [inserted(without, target, item), target];
}

/** Returns the place one step up or down, into and out of loops and to the next phase; null if there is none. */
export function neighbour(document: Document, place: Place, by: -1 | 1): Place | null {
  const [list, index] = within(place);
  const parts = at(document, list) as readonly Part[];
  const next = index + by;
  const sibling = parts[next];
  if (sibling !== undefined) {
    const inner = innerOf(sibling);
    const [where, held] = (by > 0 ? inner[0] : inner.at(-1)) ?? [null, []];
    if (where !== null) return [...list, next, ...where, by > 0 ? 0 : held.length];
    return by > 0 ? [...list, index + 2] : [...list, next];
  }
  if (list.length === 3) {
    const phase = Number(list[1]) + by;
    const other = document.phases[phase];
    return other === undefined ? null : ["phases", phase, "parts", by > 0 ? 0 : other.parts.length];
  }
  // out of the enclosing part: its list is "parts", or "of" and the name of a choice
  const around = list.slice(0, list.at(-1) === "parts" ? -1 : -2);
  return by > 0 ? [...around.slice(0, -1), Number(around.at(-1)) + 1] : around;
}

/** Formats a place with numbers from 1: "2.1", the first part of the second phase. */
export function numberOf(place: Place): string {
  return place.flatMap((name) => (typeof name === "number" ? [name + 1] : [])).join(".");
}
