/** Addresses of runs and experiments on the page, with the settings of comparisons. Pure. */

import { fillText } from "../../samples/texts";
import type { ComparisonAsked } from "../../service/api/runs";
import { TEXTS } from "./texts";

/** Paths of the run list, the metrics, a run, a run at a time, and a run with others (see `othersIn`). */
export const RUNS =
  /^\/runs(?:\/(?:(?<chart>metrics)|(?<id>\d+)(?:@(?<at>\d+(?:\.\d+)?))?(?:\/(?<others>[^/]+)(?:\/(?<how>[^/]+))?)?))?$/;

/** Paths of all experiments, of one that was run, and of a new experiment from a run. */
export const EXPERIMENTS = /^\/experiments(?:\/(?:(?<id>\d+)|as-run\/(?<asRun>\d+)))?$/;

/** Returns the address of a new experiment from a run. */
export function experimentOf(run: number): string {
  return `/experiments/as-run/${run}`;
}

/** Returns the address of a run, at a time of its recording if given, or compared with others by `how`. */
export function addressOf(
  run: number,
  others: readonly number[] = [],
  at_s: number | null = null,
  how = "",
): string {
  const own = at_s === null ? `/runs/${run}` : `/runs/${run}@${Math.max(0, at_s).toFixed(3)}`;
  if (others.length === 0) return own;
  return `${own}/${others.join(",")}${how === "" ? "" : `/${how}`}`;
}

/** Most runs that the service compares. */
export const MOST_COMPARED = 20;

interface Others {
  readonly numbers: readonly number[];
  /** Text on omitted parts of the address with the reason; "" if none. */
  readonly problem: string;
}

/** Returns the other runs of a run's address, each once and without the run itself. */
export function othersIn(text: string | undefined, run: number): Others {
  const parts = (text ?? "").split(",").filter((part) => part !== "");
  const strange = parts.filter((part) => !isNumber(part));
  const named = [...new Set(parts.filter(isNumber).map(Number))].filter((number) => number !== run);
  const more = named.slice(MOST_COMPARED - 1);
  const problems = [
    strange.length > 0 && fillText(TEXTS.invalidRuns, { parts: strange.join(", ") }),
    more.length > 0 &&
      fillText(TEXTS.tooManyRuns, {
        most: MOST_COMPARED,
        named: named.length + 1,
        runs: more.join(", "),
      }),
  ];
  return {
    numbers: named.slice(0, MOST_COMPARED - 1),
    problem: problems.filter((problem) => problem !== false).join(". "),
  };
}

function isNumber(part: string): boolean {
  return /^[1-9]\d*$/.test(part) && Number.isSafeInteger(Number(part));
}

/** Settings of a comparison in the address of the page, which contains only non-default values. Pure. */

export type AlignBy = "begin" | "step" | "event";
export type StepSignal = (typeof STEP_SIGNALS)[number];
export type EventKind = (typeof EVENT_KINDS)[number];

export const ALIGN_BY = ["begin", "step", "event"] as const;
export const STEP_SIGNALS = ["q_ref", "S_ref", "F_push"] as const;
export const EVENT_KINDS = [
  "trip",
  "trigger",
  "fault",
  "mode",
  "references",
  "tuning",
  "bank",
  "note",
] as const;
export const MOST_NUMBER = 100_000;

export interface Compared {
  /** Reference of the comparison; null for the run of the page. */
  readonly reference: number | null;
  readonly by: AlignBy;
  readonly step: StepSignal;
  readonly event: EventKind;
  /** Number of the step or event, from 1. */
  readonly number: number;
  /** Signal whose differences are shown. */
  readonly signal: string;
  /** Tolerance to each side in SI; null if none is set. */
  readonly band: number | null;
}

export const USUAL: Compared = {
  reference: null,
  by: "begin",
  step: "q_ref",
  event: "trip",
  number: 1,
  signal: "q",
  band: null,
};

/** Returns the settings as a part of the address; "" for default settings. */
export function textOf(compared: Compared): string {
  return Object.entries(compared)
    .filter(([name, value]) => value !== USUAL[name as keyof Compared])
    .map(([name, value]) => `${name}=${value}`)
    .join(";");
}

/** Reads such a part of the address; `problem` reports invalid parts, whose defaults remain. */
export function comparedIn(text: string | undefined): { compared: Compared; problem: string } {
  const valid = new Map<string, string>();
  const strange: string[] = [];
  for (const part of (text ?? "").split(";").filter((one) => one !== "")) {
    const [name = "", value = ""] = part.split("=");
    if (name in USUAL && READ[name as keyof Compared](value) !== undefined) valid.set(name, value);
    else strange.push(part);
  }
  const read = [...valid].map(([name, value]) => [name, READ[name as keyof Compared](value)]);
  return {
    compared: { ...USUAL, ...Object.fromEntries(read) },
    problem: strange.length === 0 ? "" : fillText(TEXTS.invalidSettings, { parts: strange.join(", ") }),
  };
}

const READ: { readonly [Name in keyof Compared]: (text: string) => Compared[Name] | undefined } = {
  reference: (text) => whole(text, Number.MAX_SAFE_INTEGER),
  by: (text) => ALIGN_BY.find((one) => one === text),
  step: (text) => STEP_SIGNALS.find((one) => one === text),
  event: (text) => EVENT_KINDS.find((one) => one === text),
  number: (text) => whole(text, MOST_NUMBER),
  signal: (text) => (/^\w{1,40}$/.test(text) ? text : undefined),
  band: (text) =>
    text !== "" && Number.isFinite(Number(text)) && Number(text) >= 0 ? Number(text) : undefined,
};

function whole(text: string, most: number): number | undefined {
  return /^[1-9]\d*$/.test(text) && Number(text) <= most ? Number(text) : undefined;
}

/** Returns the request to the service; the first run is the reference unless another one is selected. */
export function askedOf(runs: readonly number[], compared: Compared): ComparisonAsked {
  const { reference, by, step, event, number } = compared;
  const chosen = reference !== null && runs.includes(reference) ? reference : (runs[0] as number);
  return { run: [...runs], reference: chosen, by, step, event, number };
}
