/** A tuning in words: the λ, b, and the bank whose models it is applied to. Pure. */

import { short } from "../samples/format";
import type { Bank } from "../wire/types";

const LAMBDAS = [
  ["lam_q", "λ_q"],
  ["lam_S", "λ_S"],
  ["lam_motor", "λ_motor"],
] as const;

/** The tuning of an order or a run in one line: "λ_q 0.5 s, …, gains from geometry". */
export function tuningInWords(settings: Readonly<Record<string, unknown>>, banks: readonly Bank[]): string {
  const parts = [
    ...LAMBDAS.map(([name, symbol]) => partOf(settings[name], symbol, " s")),
    settings.b === undefined ? "b not recorded" : partOf(settings.b, "b", ""),
    bankInWords(settings.bank, banks),
    settings.interpolate === true ? "interpolating between entries" : "",
    motionInWords(settings.motion, settings.u_plan),
    rejectionInWords(settings.k_ext),
  ];
  return parts.filter((part) => part !== "").join(", ");
}

export function bankInWords(id: unknown, banks: readonly Bank[]): string {
  if (typeof id !== "number") return "";
  if (id === 0) return "gains from geometry";
  const bank = banks.find((one) => one.id === id);
  return bank === undefined ? `bank ${id}` : `bank ${bank.name} v${bank.version}`;
}

/** How references are followed; runs recorded before motions had names have a voltage limit in one of them only. */
export function motionInWords(motion: unknown, u_plan: unknown): string {
  const isTimeOptimal = motion === undefined ? Number(u_plan ?? 0) > 0 : motion === "time-optimal";
  if (!isTimeOptimal) return "lambda motion";
  return typeof u_plan === "number" ? `time-optimal motion within ${short(u_plan)} V` : "time-optimal motion";
}

/** How much of a push is fed forward; nothing where that is left to the position loop, as it ever was. */
export function rejectionInWords(k_ext: unknown): string {
  return typeof k_ext === "number" && k_ext > 0 ? `pushes rejected by ${short(k_ext)}` : "";
}

function partOf(value: unknown, symbol: string, unit: string): string {
  return typeof value === "number" ? `${symbol} ${short(value)}${unit}` : "";
}
