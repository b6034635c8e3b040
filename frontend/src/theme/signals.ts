/** Signals as people see them: hue (Okabe-Ito, safe for colour-blind eyes), line and label, the same everywhere. */

import { type Angles, FINER, readingOf } from "../samples/quantity";
import { FIELDS, type SignalName } from "../wire/sample.gen";

export const DEGREES = 180 / Math.PI;

export interface Trace {
  readonly name: string;
  readonly hue: string;
  /** References share their signal's hue and are dashed. */
  readonly dashed: boolean;
  /** Lengths of dashes and gaps that tell its recording from others [px]. */
  readonly dash?: readonly number[];
  /** Its hue tells the recording that it is of, and is not to be chosen. */
  readonly ofRecording?: boolean;
  /** Drawn under its partner and wider, so that both are seen where they are the same. */
  readonly broad?: boolean;
}

export interface Panel {
  readonly title: string;
  readonly quantity: string;
  readonly unit: string;
  /** From SI to the unit shown. */
  readonly factor: number;
  readonly decimals: number;
  /** Least height of the value axis, in the unit shown. */
  readonly narrowest: number;
  readonly traces: readonly Trace[];
}

function measured(name: SignalName, hue: string): Trace {
  return { name, hue, dashed: false };
}

function reference(name: SignalName, hue: string): Trace {
  return { name, hue, dashed: true };
}

function broad(trace: Trace): Trace {
  return { ...trace, broad: true };
}

export const HUES = {
  q: "#0072B2",
  S: "#E69F00",
  F_A: "#009E73",
  F_B: "#CC79A7",
  u_A: "#56B4E9",
  u_B: "#D55E00",
} as const;

/** Hues offered for a signal: Okabe and Ito's, and a grey, told apart by colour-blind eyes too. */
export const PALETTE = ["#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#8C949E"] as const;

const REFERENCE = [6, 4] as const;

/** Lengths of dashes and gaps of a curve [px], none of a solid one; the same wherever it is drawn. */
export function dashOf({ dash, dashed }: Trace): number[] {
  return [...(dash ?? (dashed ? REFERENCE : []))];
}

/** The signal whose colour a reference or an estimate shares. */
export function signalOf(name: string): string {
  return name.replace(/_(ref|gov|hat|true)|[′⁰¹²³⁴-⁹]/g, "");
}

/** Unit of a signal in recordings and exports (SI), and of its difference Δ. */
export function unitOf(name: string): string {
  const plain = name.replace(/^Δ|[′⁰¹²³⁴-⁹]/g, "");
  return FIELDS.find((field) => field.name === plain)?.unit ?? "1";
}

export const POSITION: Panel = {
  title: "Joint position",
  quantity: "q",
  unit: "rad",
  factor: 1,
  decimals: 4,
  narrowest: 4 / DEGREES,
  traces: [reference("q_ref", HUES.q), measured("q", HUES.q)],
};

export const STIFFNESS: Panel = {
  title: "Joint stiffness",
  quantity: "S",
  unit: "N·m/rad",
  factor: 1,
  decimals: 3,
  narrowest: 1,
  traces: [reference("S_ref", HUES.S), measured("S", HUES.S)],
};

export const FORCE: Panel = {
  title: "Tendon force",
  quantity: "F",
  unit: "N",
  factor: 1,
  decimals: 2,
  narrowest: 4,
  traces: [broad(measured("F_A", HUES.F_A)), measured("F_B", HUES.F_B)],
};

export const VOLTAGE: Panel = {
  title: "Motor voltage",
  quantity: "u",
  unit: "V",
  factor: 1,
  decimals: 2,
  narrowest: 1,
  traces: [broad(measured("u_A", HUES.u_A)), measured("u_B", HUES.u_B)],
};

const OUTSIDE = "#8C949E";

/** What acts on the joint from outside: as estimated, and on a simulator what is applied, in the place of a reference. */
export const TOUCH: Panel = {
  title: "Outside force",
  quantity: "F",
  unit: "N",
  factor: 1,
  decimals: 2,
  narrowest: 4,
  traces: [reference("F_push", OUTSIDE), measured("F_ext_hat", OUTSIDE)],
};

/** A panel in SI in the unit in which a person reads it; an angle of two decimals in degrees has four in radians. */
export function readIn(panel: Panel, angles: Angles): Panel {
  const { unit, factor } = readingOf(panel.unit, angles);
  if (factor === 1) return panel;
  return { ...panel, unit, factor, decimals: panel.decimals - FINER, narrowest: panel.narrowest * factor };
}

export const PANELS = [POSITION, STIFFNESS, FORCE, VOLTAGE, TOUCH] as const;
