/** From what stands in the form to what is asked of the service. Pure. */

import { notANumber, numberIn } from "../../samples/number";
import { type Angles, boxText } from "../../samples/quantity";
import type { IdentificationKind, IdentificationRequest, Setting } from "../../wire/types";

export type Kind = IdentificationRequest["kind"];
export type Values = Record<string, number | string>;

export interface Asked {
  /** Null while something in the form is no number. */
  readonly request: IdentificationRequest | null;
  readonly problem: string | null;
}

const MAX_TENSIONS = 8;

/** Every setting: what a person changed, else its default. All of it is shown, and sent. */
export function valuesOf(kind: IdentificationKind, changed: Values): Values {
  const values = kind.settings.map((setting) => [
    setting.name,
    changed[setting.name] ?? (setting.choices ? String(setting.default) : Number(setting.default)),
  ]);
  return Object.fromEntries(values);
}

/** Where the value of a setting comes from. */
export function originOf(setting: Setting, changed: Values, angles: Angles): string {
  const value = changed[setting.name];
  if (value === undefined || value === setting.default) return "default";
  if (setting.choices) return `default: ${setting.default}`;
  return `default: ${boxText(Number(setting.default), setting.unit, angles)}`;
}

/** `tensions` lists several, separated by commas; empty for the one among the values. */
export function requestOf(kind: IdentificationKind, values: Values, tensions: string): Asked {
  const list = tensions.split(/[,;\s]+/).filter((word) => word !== "");
  // one tension is not in use while there are several
  const used = Object.entries(values).filter(([name]) => list.length === 0 || name !== "tension_N");
  const chosen = kind.settings.filter((setting) => setting.choices).map((setting) => setting.name);
  const odd = used.find(([name, value]) => typeof value !== "number" && !chosen.includes(name));
  if (odd !== undefined) return { request: null, problem: `${odd[0]}: ${notANumber(String(odd[1]))}.` };
  const numbers = list.map(numberIn).filter((number) => number !== null);
  if (numbers.length < list.length) {
    return { request: null, problem: "Several tensions: write numbers separated by commas." };
  }
  if (numbers.length > MAX_TENSIONS) {
    return { request: null, problem: `Several tensions: at most ${MAX_TENSIONS} in turn.` };
  }
  const several = numbers.length > 0 ? { tensions_N: numbers } : {};
  return {
    request: { kind: kind.kind as Kind, ...Object.fromEntries(used), ...several } as IdentificationRequest,
    problem: null,
  };
}
