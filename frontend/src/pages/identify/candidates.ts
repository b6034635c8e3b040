/** What is set side by side of several identifications of one kind. Pure. */

import { fixed } from "../../samples/format";
import type { Identification, UnseenOutput } from "../../wire/types";

/** Runs that the service puts into one report. */
const MOST_IN_A_REPORT = 100;

export interface Estimated {
  /** As the notation spells it. */
  readonly name: string;
  readonly unit: string;
  readonly value: number;
  readonly std: number | null;
}

export interface Candidate {
  readonly run: number;
  readonly estimates: readonly Estimated[];
  readonly grade: string;
}

/** The estimates behind one output, "G_q" or "G_S" of an actuator, "A" or "B" of motors; null where there are none. */
export function candidateOf(identification: Identification, output: string): Candidate | null {
  const { run } = identification;
  const model = output === "G_q" ? identification.G_q : output === "G_S" ? identification.G_S : null;
  if (model !== null) {
    const unit = output === "G_S" ? "N·m/rad²" : "1";
    return {
      run,
      grade: model.grade,
      estimates: [
        { name: "K", unit, value: model.K, std: model.K_std },
        { name: "T", unit: "s", value: model.T, std: model.T_std },
      ],
    };
  }
  const motor = identification.motors.find(({ side }) => side === output);
  if (motor === undefined) return null;
  const { fitted, std_errors, u_c, u_c_std, grade } = motor;
  return {
    run,
    grade,
    estimates: [
      { name: "K_m", unit: "rad/(V·s)", value: fitted.K_m, std: std_errors.K_m },
      { name: "T_m", unit: "s", value: fitted.T_m, std: std_errors.T_m },
      { name: "u_c", unit: "V", value: u_c, std: u_c_std },
    ],
  };
}

/** Identifications that can be set beside this one: of its kind, with a model, newest first, itself left out. */
export function comparable(one: Identification, all: readonly Identification[]): Identification[] {
  return all.filter(({ run, kind, estimate }) => run !== one.run && kind === one.kind && estimate !== null);
}

/** Runs of the session that the newest belongs to, oldest first: those with a model that were made on its day. */
export function sessionOf(all: readonly Identification[]): number[] {
  const found = all.filter(({ estimate }) => estimate !== null);
  const day = (one: Identification) => new Date(one.created).toDateString();
  const newest = found[0];
  if (newest === undefined) return [];
  return found
    .filter((one) => day(one) === day(newest))
    .map(({ run }) => run)
    .slice(0, MOST_IN_A_REPORT)
    .reverse();
}

/** How far a value is from another, in words of the page; null where there is nothing to divide by. */
export function change(value: number, from: number): string | null {
  if (from === 0) return null;
  const percent = 100 * (value / from - 1);
  return `${percent > 0 ? "+" : ""}${fixed(percent, 1)} %`;
}

/** Where the predicted samples came from, in a sentence. */
export function recordInWords(kind: string, of: number, own: boolean): string {
  if (kind === "motor") {
    return own
      ? `Each step of run ${of}, by a model fitted to its other steps.`
      : `Each step of run ${of}, by a model that has not seen that run.`;
  }
  return own
    ? `The last third of run ${of}, by a model fitted to its first two thirds.`
    : `The last third of run ${of}, by a model that has not seen that run.`;
}

export function outputTitle(output: UnseenOutput): string {
  return output.name.startsWith("G_") ? output.name : `Motor ${output.name}`;
}
