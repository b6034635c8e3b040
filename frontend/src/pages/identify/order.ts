/** From what stands in the form to what is asked of the service. Pure. */

import type { IdentificationKind, IdentificationRequest } from "../../wire/types";

export type Kind = IdentificationRequest["kind"];
export type Values = Record<string, number | string>;

export interface Asked {
  /** Null while something in the form is no number. */
  readonly request: IdentificationRequest | null;
  readonly problem: string | null;
}

const MAX_TENSIONS = 8;

/** `tensions` lists several, separated by commas; empty for the one among the values. */
export function requestOf(kind: IdentificationKind, values: Values, tensions: string): Asked {
  const empty = Object.entries(values).find(([, value]) => typeof value !== "number");
  if (empty !== undefined) return { request: null, problem: `${empty[0]} needs a number.` };
  const list = tensions.split(/[,;\s]+/).filter((word) => word !== "");
  const numbers = list.map(Number);
  if (numbers.some((number) => !Number.isFinite(number))) {
    return { request: null, problem: "Several tensions: write numbers separated by commas." };
  }
  if (numbers.length > MAX_TENSIONS) {
    return { request: null, problem: `Several tensions: at most ${MAX_TENSIONS} in turn.` };
  }
  const several = numbers.length > 0 ? { tensions_N: numbers } : {};
  return {
    request: { kind: kind.kind as Kind, ...values, ...several } as IdentificationRequest,
    problem: null,
  };
}
