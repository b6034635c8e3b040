/** The parts that an experiment may have, as forms: which boxes each has, and how a new one begins. Pure. */

import type { Part, Value } from "./document";
import { innerOf } from "./document";

export interface Box {
  readonly name: string;
  readonly words: string;
  readonly unit: string;
  /** May be left out: what it names stays as it is, or is as usual. */
  readonly optional?: boolean;
  readonly choices?: readonly string[];
}

export interface PartForm {
  readonly words: string;
  readonly boxes: readonly Box[];
  /** What a new one has. */
  readonly begins: Readonly<Record<string, Value | Part[]>>;
}

const box = (name: string, words: string, unit: string): Box => ({ name, words, unit });
const maybe = (name: string, words: string, unit: string): Box => ({ name, words, unit, optional: true });

const TIME = box("duration_s", "Time", "s");
const AIM = [maybe("q_ref", "q_ref", "rad"), maybe("S_ref", "S_ref", "N·m/rad")];
const AMPLITUDES = [
  maybe("q_amplitude", "Amplitude of q", "rad"),
  maybe("S_amplitude", "Amplitude of S", "N·m/rad"),
];

export const PART_FORMS: Readonly<Record<string, PartForm>> = {
  hold: { words: "Hold", boxes: [TIME], begins: { duration_s: 2 } },
  step: { words: "Step", boxes: [...AIM, TIME], begins: { q_ref: 0, duration_s: 2 } },
  ramp: { words: "Ramp", boxes: [...AIM, TIME], begins: { q_ref: 0, duration_s: 2 } },
  pulse: {
    words: "Pulse",
    boxes: [...AIM, TIME, box("rest_s", "Rest", "s")],
    begins: { q_ref: 0.2, duration_s: 2, rest_s: 2 },
  },
  sine: {
    words: "Sine",
    boxes: [...AMPLITUDES, box("period_s", "Period", "s"), TIME],
    begins: { q_amplitude: 0.2, period_s: 4, duration_s: 8 },
  },
  sweep: {
    words: "Sweep",
    boxes: [...AMPLITUDES, box("from_Hz", "From", "Hz"), box("to_Hz", "To", "Hz"), TIME],
    begins: { q_amplitude: 0.05, from_Hz: 0.1, to_Hz: 1, duration_s: 20 },
  },
  prbs: {
    words: "PRBS",
    boxes: [
      ...AMPLITUDES,
      box("chip_s", "Chip", "s"),
      box("bits", "Bits", "1"),
      maybe("periods", "Periods", "1"),
    ],
    begins: { q_amplitude: 0.05, chip_s: 0.2, bits: 6 },
  },
  multisine: {
    words: "Multisine",
    boxes: [
      ...AMPLITUDES,
      box("period_s", "Period", "s"),
      box("lines", "Lines", "1"),
      maybe("periods", "Periods", "1"),
    ],
    begins: { q_amplitude: 0.05, period_s: 8, lines: 10 },
  },
  push: {
    words: "Push",
    boxes: [
      box("F_push", "Force", "N"),
      TIME,
      { name: "shape", words: "Shape", unit: "1", choices: ["step", "ramp", "smooth"] },
    ],
    begins: { F_push: 5, duration_s: 2, shape: "step" },
  },
  hand: {
    words: "Hand",
    boxes: [
      box("F_push", "Force", "N"),
      box("pushes", "Pushes", "1"),
      box("pause_s", "Pause", "s"),
      maybe("seed", "Seed", "1"),
    ],
    begins: { F_push: 5, pushes: 3, pause_s: 2 },
  },
  load: {
    words: "Load of the shafts",
    boxes: [maybe("load_A", "Load A", "N·m"), maybe("load_B", "Load B", "N·m"), TIME],
    begins: { load_A: 0.05, duration_s: 2 },
  },
  wall: {
    words: "Wall",
    boxes: [
      box("q_wall", "q_wall", "rad"),
      { name: "side", words: "Stands", unit: "1", choices: ["above", "below"] },
      maybe("k_wall", "Stiffness", "N/m"),
      maybe("c_wall", "Damping", "s/m"),
    ],
    begins: { q_wall: 0.5, side: "above" },
  },
  no_wall: { words: "No wall", boxes: [], begins: {} },
  tuning: {
    words: "Tuning",
    boxes: [
      maybe("lam_q", "λ_q", "s"),
      maybe("lam_S", "λ_S", "s"),
      maybe("lam_motor", "λ_motor", "s"),
      maybe("b", "b", "1"),
      maybe("bank", "Bank", "1"),
      { name: "motion", words: "Motion", unit: "1", choices: ["lambda", "time-optimal"], optional: true },
      maybe("u_plan", "Voltage limit", "V"),
      maybe("k_ext", "k_ext", "1"),
    ],
    begins: { lam_q: 0.8 },
  },
  learn: { words: "Learn", boxes: [maybe("duration_s", "Time", "s")], begins: { duration_s: 2 } },
  until_contact: {
    words: "Until contact",
    boxes: [maybe("contact_N", "Contact", "N")],
    begins: { contact_N: 1.5, parts: [{ do: "hold", duration_s: 2 }] },
  },
  repeat: {
    words: "Repeat",
    boxes: [box("times", "Times", "1")],
    begins: { times: 2, parts: [{ do: "hold", duration_s: 2 }] },
  },
};

/** A new part of a kind; of another one it keeps what both have, so that a step becomes a ramp to the same place. */
export function partOf(kind: string, other?: Part): Part {
  const form = PART_FORMS[kind];
  const kept = Object.fromEntries(
    Object.entries(other ?? {}).filter(
      ([name]) => name !== "do" && form?.boxes.some((one) => one.name === name),
    ),
  );
  const begins = form?.begins ?? {};
  const inner = other === undefined ? undefined : innerOf(other)[0]?.[1];
  const parts = "parts" in begins && inner !== undefined ? { parts: [...inner] } : {};
  // a reference that the other leaves as it is is none that a new one would move
  const aims = "q_ref" in kept || "S_ref" in kept ? { ...begins, q_ref: undefined } : begins;
  // a sine that was something else is one whole period as long as that
  const period =
    kind === "sine" && !("period_s" in kept) && "duration_s" in kept ? { period_s: kept.duration_s } : {};
  return stripped({ do: kind, ...aims, ...kept, ...period, ...parts });
}

/** A part without what is left out. */
export function stripped(part: Part): Part {
  return Object.fromEntries(Object.entries(part).filter(([, value]) => value !== undefined)) as Part;
}
