/** How signals are drawn: hue (Okabe-Ito, safe for colour-blind people), line and digits, the same in all charts. */

import { derivedSignal } from "../samples/formula";
import { COMBINED, FIELDS } from "../wire/sample.gen";

export const DEGREES = 180 / Math.PI;

export interface Trace {
  readonly name: string;
  readonly hue: string;
  /** References share their signal's hue and are dashed. */
  readonly dashed: boolean;
  /** Lengths of dashes and gaps that distinguish recordings [px]. */
  readonly dash?: readonly number[];
  /** The hue identifies the recording; a person cannot choose it. */
  readonly ofRecording?: boolean;
  /** Drawn under its partner and wider, so that both are visible where they coincide. */
  readonly broad?: boolean;
}

/** How the values of an axis are displayed. */
export interface Scale {
  readonly unit: string;
  /** Factor from SI to the unit shown. */
  readonly factor: number;
  readonly decimals: number;
  /** Minimum length of the axis, in the unit shown. */
  readonly narrowest: number;
}

export interface Panel extends Scale {
  readonly title: string;
  readonly traces: readonly Trace[];
  /** Signal of the horizontal axis; time if omitted. */
  readonly over?: Scale & { readonly name: string };
  /** Height as a multiple of a normal panel; 1 if omitted. */
  readonly share?: number;
}

/** All signals that can be drawn. */
export const DRAWN = [...FIELDS, ...COMBINED].map(({ name, unit, meaning }) => ({ name, unit, meaning }));
const BY_NAME: ReadonlyMap<string, (typeof DRAWN)[number]> = new Map(DRAWN.map((one) => [one.name, one]));
const SUMS: ReadonlySet<string> = new Set(COMBINED.map(({ name }) => name));

/** Whether a signal is computed from others sample by sample and not stored. */
export function isSum(name: string): boolean {
  return SUMS.has(name) || derivedSignal(name) !== undefined;
}

export const HUES = {
  q: "#0072B2",
  S: "#E69F00",
  F_A: "#009E73",
  F_B: "#CC79A7",
  u_A: "#56B4E9",
  u_B: "#D55E00",
} as const;

const GREY = "#8C949E";
/** Hues of signals without an own one: those of a side are drawn as its tendon force, external forces are grey. */
const FURTHER_HUES: Readonly<Record<string, string>> = {
  F_push: GREY,
  F_ext: GREY,
  F_wall: HUES.u_B,
  mode: GREY,
  run: GREY,
  fault: HUES.u_B,
  limits: HUES.S,
  overruns: HUES.u_B,
  lam_S: HUES.S,
};

/** Hues offered for a signal: the Okabe-Ito palette and a grey, distinguishable by colour-blind people. */
export const PALETTE = ["#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#8C949E"] as const;

const REFERENCE = [6, 4] as const;
/** Dashes of a governed reference. */
const GOVERNED = [10, 3, 2, 3] as const;

/** CSS variable with which a theme replaces a hue, for contrast with its background. */
export function variableOf(hue: string): string {
  return `--hue-${hue.slice(1).toLowerCase()}`;
}

/** CSS colour of a hue in the active theme; canvases use `ChartColours`. */
export function paintOf(hue: string): string {
  return hue.startsWith("#") ? `var(${variableOf(hue)}, ${hue})` : hue;
}

/** Lengths of dashes and gaps of a curve [px]; empty for a solid one. */
export function dashOf({ dash, dashed }: Trace): number[] {
  return [...(dash ?? (dashed ? REFERENCE : []))];
}

/** Signal whose colour a reference, an estimate or an error shares. */
export function signalOf(name: string): string {
  return (name.split(" - ")[0] as string).replace(/_(ref|gov|hat|true)|[′⁰¹²³⁴-⁹]/g, "");
}

/** SI unit of a signal in recordings and exports, and of its difference Δ. */
export function unitOf(name: string): string {
  const plain = name.replace(/^Δ|[′⁰¹²³⁴-⁹]/g, "");
  return (BY_NAME.get(plain) ?? derivedSignal(plain))?.unit ?? "1";
}

export function isDrawn(name: string): boolean {
  return BY_NAME.has(name) || derivedSignal(name) !== undefined;
}

export function meaningOf(name: string): string {
  const derived = derivedSignal(name);
  return BY_NAME.get(name)?.meaning ?? (derived?.meaning || derived?.expression) ?? "";
}

/** How a signal is drawn together with others. */
export function traceFor(name: string, others: readonly string[]): Trace {
  const signal = signalOf(name);
  const own: Readonly<Record<string, string>> = HUES;
  const hue = own[signal] ?? FURTHER_HUES[signal] ?? (/_B/.test(name) ? HUES.F_B : undefined);
  const trace = { name, hue: hue ?? (/_A/.test(name) ? HUES.F_A : HUES.q), dashed: isDashed(name, others) };
  const governed = /_gov$/.test(name) ? { dash: GOVERNED } : {};
  const partner = trace.dashed ? signal : name.replaceAll("_A", "_B");
  return { ...trace, ...governed, ...(partner !== name && others.includes(partner) ? { broad: true } : {}) };
}

/**
 * Whether the line is dashed: references are, and of two errors of one signal the one against the governed reference.
 */
function isDashed(name: string, others: readonly string[]): boolean {
  if (name === "F_push" || name === "S_true") return true;
  if (!/_(ref|gov)$/.test(name)) return false;
  if (!name.includes(" - ")) return true;
  return /_gov$/.test(name) && others.some((one) => one !== name && signalOf(one) === signalOf(name));
}

const BY_UNIT: Readonly<Record<string, Scale>> = {
  rad: { unit: "rad", factor: 1, decimals: 4, narrowest: 4 / DEGREES },
  "rad/s": { unit: "rad/s", factor: 1, decimals: 4, narrowest: 10 / DEGREES },
  "N·m/rad": { unit: "N·m/rad", factor: 1, decimals: 3, narrowest: 1 },
  N: { unit: "N", factor: 1, decimals: 2, narrowest: 4 },
  V: { unit: "V", factor: 1, decimals: 2, narrowest: 1 },
  m: { unit: "mm", factor: 1000, decimals: 2, narrowest: 2 },
  s: { unit: "s", factor: 1, decimals: 3, narrowest: 0.2 },
  "1": { unit: "1", factor: 1, decimals: 0, narrowest: 1 },
};
/** Errors are small: one more decimal, and an axis that may be ten times as short. */
const FINER_ERROR = 10;
const LATENESS: Scale = { unit: "ms", factor: 1000, decimals: 3, narrowest: 0.2 };

const DECIMALS = 4;
const NARROWEST = 1e-6;

/** Scale of a derived signal, which may have any magnitude and any unit. */
function ofDerived(unit: string): Scale {
  const own = unit === "1" ? undefined : BY_UNIT[unit];
  return own ?? { unit, factor: 1, decimals: DECIMALS, narrowest: NARROWEST };
}

/** Scale of one axis for signals of one unit. */
export function scaleOf(names: readonly string[]): Scale {
  const unit = unitOf(names[0] ?? "");
  if (names.length > 0 && names.every((name) => name === "lateness_s")) return LATENESS;
  if (names.some((name) => derivedSignal(name) !== undefined)) return ofDerived(unit);
  const scale = BY_UNIT[unit] as Scale;
  if (names.includes("bank_entry")) return { ...scale, decimals: 2 };
  const errors = names.length > 0 && names.every((name) => SUMS.has(name) && unit !== "m" && unit !== "N");
  return errors
    ? { ...scale, decimals: scale.decimals + 1, narrowest: scale.narrowest / FINER_ERROR }
    : scale;
}
