/** State of a simulated plant and definitions of forms, as the service sends them. */

import type { ExperimentKind, State } from "../wire/types";

export const TUNING = {
  lam_q: 0.5,
  lam_S: 0.42,
  lam_motor: 0.0854,
  b: 0,
  interpolate: false,
  motion: "lambda",
  u_plan: 8.5,
  k_ext: 0,
  bank: null,
};
export const STATE = {
  mode: "run",
  legal_modes: ["experiment", "identify"],
  limits: { F_push_max: 30, k_wall_min: 100, k_wall_max: 28000, c_wall_max: 4 },
  plant: { simulated: true },
  wall: null,
  tuning: { ...TUNING, lam_motor_min: 0.05, lam_motor_max: 0.2 },
  own_tuning: null,
  task: null,
  trial: null,
  fault: null,
  touch: { contact_N: 0, learned: [], felt: null },
  link: { alive: true, starts: 1 },
} as unknown as State;
export const TRACKING = {
  name: "tracking",
  title: "Tracking",
  description: "",
  duration_s: 4,
  why_not: "",
  settings: [
    { name: "law", meaning: "law in use", unit: "1", default: "cascade", choices: ["cascade", "pd"] },
    { name: "interpolate", meaning: "gain scheduling", unit: "1", default: false },
    { name: "bank", meaning: "bank", unit: "1", default: 0 },
  ],
} as unknown as ExperimentKind;
const NUMBER = { unit: "N", default: 20, minimum: 5, maximum: 45 };
export const KINDS = [
  {
    kind: "actuator",
    title: "Actuator",
    description: "",
    settings: [
      { ...NUMBER, name: "tension_N", meaning: "tension held" },
      {
        name: "estimator",
        meaning: "what makes the models",
        unit: "1",
        default: "default",
        choices: ["default", "arx"],
      },
    ],
  },
];
