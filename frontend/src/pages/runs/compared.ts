/** How runs are compared, as it stands in the address of the page: only what is not as usual. Pure. */

import type { ComparisonAsked } from "../../service/runs";

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
    problem: strange.length === 0 ? "" : `the address has ${strange.join(", ")}, which says nothing here`,
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
