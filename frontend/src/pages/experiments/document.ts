import { TEXTS } from "./texts";

/** An experiment as the composer edits it: its document as the service reads it, changed by place. Pure. */

/** A number in SI, or an expression of the experiment's settings. */
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

/** A document that the composer can show: whatever else is wrong with it the service tells, at its place. */
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

/** The document of a text in JSON; null for any other text, which the service reads. */
export function documentIn(text: string): Document | null {
  try {
    return asDocument(JSON.parse(text));
  } catch {
    return null;
  }
}

/** A document as a text: JSON, which the service takes as YAML, with each part on a line of its own. */
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

/** The lists of parts within a part, each with its place there. */
export function innerOf(part: Part): [Place, readonly Part[]][] {
  if (Array.isArray(part.parts)) return [[["parts"], part.parts]];
  if (part.do === "choose" && typeof part.of === "object") {
    return Object.entries(part.of as Record<string, Part[]>).map(([name, parts]) => [["of", name], parts]);
  }
  return [];
}

type Tree = Record<string | number, unknown>;

/** What stands at a place. */
function at(document: unknown, place: Place): unknown {
  return place.reduce((here, name) => (here as Tree | undefined)?.[name], document);
}

/** The same with something else at a place. */
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

/** The list that an item stands in, and where in it. */
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

/** Whether one place lies in another, or is it. */
function lies(place: Place, around: Place): boolean {
  return around.every((name, index) => place[index] === name);
}

/**
 * A part taken from one place and put before what stands at another, and where it is then; into itself it cannot go.
 * The list may be anywhere: a loop, another phase.
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

/** Where a part goes that is moved one place up or down: into loops and out of them, and to the next phase. */
export function beside(document: Document, place: Place, by: -1 | 1): Place | null {
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
  // out of the part around it: a list of parts is "parts" of it, or "of" and the name of a choice
  const around = list.slice(0, list.at(-1) === "parts" ? -1 : -2);
  return by > 0 ? [...around.slice(0, -1), Number(around.at(-1)) + 1] : around;
}

/** A place among parts as a person counts: "2.1", the first part of the second phase. */
export function numberOf(place: Place): string {
  return place.flatMap((name) => (typeof name === "number" ? [name + 1] : [])).join(".");
}
