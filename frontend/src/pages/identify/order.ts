/** From what stands in the form to what is asked of the service. Pure. */

import { notANumber, numberIn } from "../../samples/number";
import { type Angles, boxText, offered } from "../../samples/quantity";
import type { IdentificationKind, IdentificationRequest, Setting } from "../../wire/types";

export type Kind = IdentificationRequest["kind"];
export type Values = Record<string, number | string>;

export interface Asked {
  /** Null while something in the form is no number. */
  readonly request: IdentificationRequest | null;
  readonly problem: string | null;
  /** Of the field that the problem is about. */
  readonly place?: string;
}

const MAX_TENSIONS = 8;

/** Short labels; the setting's own meaning stands below the box. */
const LABELS: Record<string, string> = {
  tension_N: "Tension",
  amplitude_rad: "PRBS amplitude",
  chip_s: "Chip length",
  bits: "Register bits",
  periods: "Periods",
  settle_s: "Settling",
  estimator: "Estimator",
  u_low: "Smallest step",
  u_high: "Largest step",
  levels: "Voltages",
  travel_rad: "Travel",
  step_s: "Longest step",
  F_low: "Lowest tension",
  F_high: "Highest tension",
  sweep_s: "One way",
  cycles: "Times up and down",
};

export function labelOf({ name, meaning }: Setting): string {
  return LABELS[name] ?? meaning;
}

/** Every setting: what a person changed, else its default. All of it is shown, and sent. */
export function valuesOf(kind: IdentificationKind, changed: Values, angles: Angles): Values {
  const values = kind.settings.map((setting) => [
    setting.name,
    changed[setting.name] ?? usualOf(setting, angles),
  ]);
  return Object.fromEntries(values);
}

/** Where the value of a setting comes from. */
export function originOf(setting: Setting, changed: Values, angles: Angles): string {
  const [value, usual] = [changed[setting.name], usualOf(setting, angles)];
  if (value === undefined || value === usual) return "default";
  return `default: ${typeof usual === "number" ? boxText(usual, setting.unit, angles) : usual}`;
}

function usualOf(setting: Setting, angles: Angles): number | string {
  return setting.choices ? String(setting.default) : offered(Number(setting.default), setting, angles);
}

/** `tensions` lists several, separated by commas; empty for the one among the values. */
export function requestOf(kind: IdentificationKind, values: Values, tensions: string): Asked {
  const list = tensions.split(/[,;\s]+/).filter((word) => word !== "");
  // one tension is not in use while there are several
  const used = Object.entries(values).filter(([name]) => list.length === 0 || name !== "tension_N");
  const chosen = kind.settings.filter((setting) => setting.choices).map((setting) => setting.name);
  const odd = used.find(([name, value]) => typeof value !== "number" && !chosen.includes(name));
  if (odd !== undefined) {
    const [place, value] = odd;
    const setting = kind.settings.find(({ name }) => name === place);
    const label = setting === undefined ? place : labelOf(setting);
    return { request: null, problem: `${label}: ${notANumber(String(value))}.`, place };
  }
  const numbers = list.map(numberIn).filter((number) => number !== null);
  const place = "tensions_N";
  const word = list.find((one) => numberIn(one) === null);
  if (word !== undefined) {
    const problem = `Several tensions: ${notANumber(word)}; write numbers separated by commas.`;
    return { request: null, problem, place };
  }
  if (numbers.length > MAX_TENSIONS) {
    return { request: null, problem: `Several tensions: at most ${MAX_TENSIONS} in turn.`, place };
  }
  const several = numbers.length > 0 ? { tensions_N: numbers } : {};
  return {
    request: { kind: kind.kind as Kind, ...Object.fromEntries(used), ...several } as IdentificationRequest,
    problem: null,
  };
}
