/** A study as its form edits it: the document as the service reads it, and as a text again. Pure. */

export type Value = boolean | number | string;

/** What is gone through: `values`, or `count` of them from `first` to `last`. A box may hold what is no number yet. */
export interface Axis {
  readonly over: string;
  readonly values?: readonly Value[];
  readonly first?: Value;
  readonly last?: Value;
  readonly count?: Value;
  readonly spacing?: string;
}

/** How a number of the plant is drawn. */
export interface Spread {
  readonly of: string;
  readonly by?: string;
  readonly relative?: Value;
  readonly absolute?: Value;
}

export interface StudyDocument {
  readonly name: string;
  readonly title: string;
  readonly experiment?: string;
  readonly settings?: Readonly<Record<string, Value>>;
  readonly axes?: readonly Axis[];
  readonly spread?: readonly Spread[];
  readonly draws?: Value;
  readonly seeds?: Value;
  readonly seed?: Value;
  readonly [other: string]: unknown;
}

export const EMPTY_STUDY: StudyDocument = {
  format: 1,
  name: "mine",
  title: "Own study",
  experiment: "tracking",
  settings: { motion: "lambda" },
  axes: [{ over: "lam_q", first: 0.4, last: 1, count: 5 }],
};

/** A document that the form can show; whatever else is wrong with it the service says. */
export function asStudy(read: unknown): StudyDocument | null {
  if (typeof read !== "object" || read === null || Array.isArray(read)) return null;
  const { axes = [], spread = [], settings = {}, name = "", title = "" } = read as Record<string, unknown>;
  const isShown =
    typeof name === "string" &&
    typeof title === "string" &&
    isRecord(settings) &&
    Array.isArray(axes) &&
    axes.every((axis) => isRecord(axis) && (axis.values === undefined || Array.isArray(axis.values))) &&
    Array.isArray(spread) &&
    spread.every(isRecord);
  return isShown ? (read as StudyDocument) : null;
}

function isRecord(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

/** The document as a text: YAML with an axis and a spread on a line each; what is left out is left out. */
export function writeStudy(document: StudyDocument): string {
  const lines = Object.entries(document).flatMap(([name, value]) => {
    if (value === undefined || (Array.isArray(value) && value.length === 0)) return [];
    if ((name === "axes" || name === "spread") && Array.isArray(value)) {
      return [`${name}:`, ...value.map((one) => `  - ${flow(one)}`)];
    }
    return [`${name}: ${flow(value)}`];
  });
  return `${lines.join("\n")}\n`;
}

const PLAIN = /^[A-Za-z][A-Za-z0-9_.@]*$/;
const WORDS = new Set(["true", "false", "null"]);

/** In one line, as YAML; a text that could be read as something else stands between quotes, as in JSON. */
function flow(value: unknown): string {
  if (typeof value === "string") {
    return PLAIN.test(value) && !WORDS.has(value) ? value : JSON.stringify(value);
  }
  if (Array.isArray(value)) return `[${value.map(flow).join(", ")}]`;
  if (isRecord(value)) {
    const entries = Object.entries(value).filter(([, one]) => one !== undefined);
    return `{${entries.map(([name, one]) => `${flow(name)}: ${flow(one)}`).join(", ")}}`;
  }
  return JSON.stringify(value);
}

/** The words of a list of values as numbers in SI where they are numbers, else as they are. */
export function valuesIn(text: string, inSI: (word: string) => number | null): Value[] {
  return text
    .split(/[,;\s]+/)
    .filter((word) => word !== "")
    .map((word) => (word === "true" ? true : word === "false" ? false : (inSI(word) ?? word)));
}
