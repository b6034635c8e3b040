/** Addresses of runs and experiments on the page, and how runs are compared in them. Pure. */

import { fillText } from "../../samples/texts";
import type { ComparisonAsked } from "../../service/api/runs";
import { TEXTS } from "./texts";

/** Addresses of runs on the page. Pure. */

/** All runs, their metrics, a run, a run at a second of it, a run beside others, whatever these are: `othersIn` says what is wrong with them. */
export const RUNS =
  /^\/runs(?:\/(?:(?<chart>metrics)|(?<id>\d+)(?:@(?<at>\d+(?:\.\d+)?))?(?:\/(?<others>[^/]+)(?:\/(?<how>[^/]+))?)?))?$/;

/** All experiments, one that was run, one to be made of a run. */
export const EXPERIMENTS = /^\/experiments(?:\/(?:(?<id>\d+)|as-run\/(?<asRun>\d+)))?$/;

/** Where a run is made an experiment. */
export function experimentOf(run: number): string {
  return `/experiments/as-run/${run}`;
}

/** A run by itself, at a second of its recording where one is given, or beside others, compared as `how` says. */
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

/** As many as the service sets beside each other. */
export const MOST_COMPARED = 20;

interface Others {
  readonly numbers: readonly number[];
  /** What of the address is left out, and why; "" where nothing is. */
  readonly problem: string;
}

/** The runs beside a run in its address, each once and without the run itself. */
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

/** How runs are compared, as it stands in the address of the page: only what is not as usual. Pure. */

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
  /** The run that all others are compared with; null: the one whose page it is. */
  readonly reference: number | null;
  readonly by: AlignBy;
  readonly step: StepSignal;
  readonly event: EventKind;
  /** Which step or event, from 1. */
  readonly number: number;
  /** Whose differences are shown. */
  readonly signal: string;
  /** Tolerance to either side in SI; null where none is given. */
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

/** A part of the address; "" where all is as usual. */
export function textOf(compared: Compared): string {
  return Object.entries(compared)
    .filter(([name, value]) => value !== USUAL[name as keyof Compared])
    .map(([name, value]) => `${name}=${value}`)
    .join(";");
}

/** What such a part says; `problem` tells what of it means nothing, and is left as usual. */
export function comparedIn(text: string | undefined): { compared: Compared; problem: string } {
  const said = new Map<string, string>();
  const strange: string[] = [];
  for (const part of (text ?? "").split(";").filter((one) => one !== "")) {
    const [name = "", value = ""] = part.split("=");
    if (name in USUAL && READ[name as keyof Compared](value) !== undefined) said.set(name, value);
    else strange.push(part);
  }
  const read = [...said].map(([name, value]) => [name, READ[name as keyof Compared](value)]);
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

/** What is asked of the service: of these runs, the first of them the reference unless another one is chosen. */
export function askedOf(runs: readonly number[], compared: Compared): ComparisonAsked {
  const { reference, by, step, event, number } = compared;
  const chosen = reference !== null && runs.includes(reference) ? reference : (runs[0] as number);
  return { run: [...runs], reference: chosen, by, step, event, number };
}
