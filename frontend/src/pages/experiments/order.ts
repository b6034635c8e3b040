/** From what is in force and what a person changed to what an experiment's form shows, which is what it sends. Pure. */

import { notANumber } from "../../samples/number";
import { type Angles, boxText, offered, told } from "../../samples/quantity";
import { counted } from "../../samples/words";
import { bankInWords } from "../../service/tuningWords";
import type { Bank, ExperimentKind, Setting, State } from "../../wire/types";

export type Value = boolean | number | string;
export type Values = Record<string, Value>;

/** Of the loop, the same for every kind. */
const TUNING = ["lam_q", "lam_S", "lam_motor", "b", "interpolate", "motion", "u_plan", "k_ext"] as const;
const OF_THE_LOOP = new Set<string>([...TUNING, "bank", "seed"]);

export function isOfTheLoop(setting: Setting): boolean {
  return OF_THE_LOOP.has(setting.name);
}

/** Whether there is more than one value to choose from: the seed of a service that runs is settled. */
export function hasChoice({ minimum, maximum }: Setting): boolean {
  return minimum == null || maximum == null || minimum < maximum;
}

/** One setting as the form shows it. */
export interface Shown {
  readonly setting: Setting;
  readonly value: Value;
  /** Where the value comes from, for the person who reads it. */
  readonly origin: string;
}

/**
 * Every setting of a kind: what a person changed, else the operator's tuning in force, else the default. While a run
 * has a tuning of its own, the operator's is what comes back after it.
 */
export function shownSettings(
  kind: ExperimentKind,
  state: State | null,
  changed: Values,
  angles: Angles,
): Shown[] {
  const inForce = tuningOf(state);
  return kind.settings.map((setting) => {
    const standing = inForce[setting.name];
    const start = standing ?? offered(setting.default ?? "", setting, angles);
    const value = changed[setting.name] ?? start;
    const word = standing === undefined ? "default" : "in force";
    const origin = value === start ? word : `${word}: ${inWords(setting, start, angles)}`;
    return { setting: withRange(setting, state), value, origin };
  });
}

export interface Order {
  /** Null while a number box holds something else. */
  readonly order: { readonly name: string; readonly settings: Values } | null;
  readonly problem: string | null;
}

/** All that is shown, to be sent. */
export function orderOf(kind: ExperimentKind, shown: readonly Shown[]): Order {
  for (const { setting, value } of shown) {
    if (typeof setting.default === "number" && typeof value !== "number") {
      return { order: null, problem: `${sentence(setting.meaning)}: ${notANumber(String(value))}.` };
    }
  }
  const settings = Object.fromEntries(shown.map(({ setting, value }) => [setting.name, value]));
  return { order: { name: kind.name, settings }, problem: null };
}

/** What differs from a kind's defaults, the loop's settings aside: "joint position held: 11.5°"; segments by length. */
export function changesInWords(
  settings: Readonly<Record<string, unknown>>,
  kind: ExperimentKind,
  angles: Angles,
): string {
  const parts = kind.settings
    .filter((setting) => !isOfTheLoop(setting))
    .filter((setting) => settings[setting.name] !== undefined && !isUsual(setting, settings[setting.name]))
    .map((setting) => {
      const { name, unit, meaning } = setting;
      const value = settings[name];
      if (name === "segments") return segmentsInWords(String(value));
      const [words] = meaning.split("; "); // what follows explains
      return `${words}: ${typeof value === "number" ? told(value, unit, angles) : inWords(setting, value as Value, angles)}`;
    });
  return parts.length === 0 ? "its own settings at their defaults" : parts.join("; ");
}

/** Whether a value is the default, or what a form offers as such. */
function isUsual(setting: Setting, value: unknown): boolean {
  return value === setting.default || value === offered(setting.default, setting, "deg");
}

/** What of an order's tuning differs from the one in force: "λ_q 0.8 s (in force 0.5 s)"; "" where nothing does. */
export function tuningChanges(
  settings: Readonly<Record<string, unknown>>,
  inForce: Values,
  kind: ExperimentKind,
  angles: Angles,
): string {
  return kind.settings
    .filter(({ name }) => settings[name] !== undefined && inForce[name] !== undefined)
    .filter(({ name }) => settings[name] !== inForce[name])
    .filter(({ name }) => name !== "u_plan" || settings.motion === "time-optimal")
    .map((setting) => {
      const { name, symbol, unit } = setting;
      const words = (value: Value) =>
        typeof value === "number" && name !== "bank"
          ? told(value, unit, angles)
          : inWords(setting, value, angles);
      return `${symbol} ${words(settings[name] as Value)} (in force ${words(inForce[name] as Value)})`;
    })
    .join(", ");
}

/** Choices of a bank: geometry, and every bank there is. */
export function bankChoices(banks: readonly Bank[]): { value: string; label: string }[] {
  return [0, ...banks.map(({ id }) => id)].map((id) => ({
    value: String(id),
    label: bankInWords(id, banks),
  }));
}

/** The operator's tuning as the settings of an order; empty while nothing is known of it. */
export function tuningOf(state: State | null): Values {
  if (state === null) return {};
  const tuning = state.own_tuning ?? state.tuning;
  const parts = TUNING.map((name) => [name, tuning[name]] as const);
  return { ...Object.fromEntries(parts), bank: tuning.bank?.id ?? 0 };
}

/** Settings of the loop whose range depends on the plant in use. */
const OF_THE_PLANT = ["lam_q", "lam_S", "lam_motor", "u_plan"] as const;

function withRange(setting: Setting, state: State | null): Setting {
  const name = OF_THE_PLANT.find((one) => one === setting.name);
  if (state === null || name === undefined) return setting;
  return { ...setting, minimum: state.tuning[`${name}_min`], maximum: state.tuning[`${name}_max`] };
}

function inWords({ name, unit }: Setting, value: Value, angles: Angles): string {
  if (name === "bank") return bankInWords(value, []);
  if (typeof value === "boolean") return value ? "yes" : "no";
  return typeof value === "number" ? boxText(value, unit, angles) : value;
}

function segmentsInWords(json: string): string {
  try {
    const list: unknown = JSON.parse(json);
    const total_s = (list as { duration_s: number }[]).reduce((sum, { duration_s }) => sum + duration_s, 0);
    return `${counted((list as unknown[]).length, "segment")}, ${Number(total_s.toFixed(3))} s`;
  } catch {
    return "segments of its own";
  }
}

function sentence(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
