/** The tuning: queries, changes, trials, undo; why a change would be refused, and a tuning in words. */

import { useDebouncedValue, useLocalStorage } from "@mantine/hooks";
import { queryOptions, useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useLive } from "../../live/react";
import { digitsApart, short } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { answered, api } from "../../wire/client";
import { DEVIATIONS, UNSEEN_F } from "../../wire/sample.gen";
import type { Bank, State, Tuning, TuningPreview, TuningRequest } from "../../wire/types";
import { TEXTS } from "../texts";
import { OTHERS_MS } from "./polling";

/** What a preview is asked for; the rest of the tuning is that in use. */
interface PreviewRequest {
  readonly lam_q: number;
  readonly lam_S: number;
  readonly motion: Tuning["motion"];
  readonly u_plan: number;
  readonly k_ext: number;
  /** Undefined for that of the present reference. */
  readonly S: number | undefined;
  /** With the printed formula (E1) beside it. */
  readonly printed: boolean;
}

/** `tuning` is the rest of the tuning, as a word: another one has another preview. */
function previewQuery(wanted: PreviewRequest, tuning: string) {
  return queryOptions({
    queryKey: ["tuning", "preview", wanted, tuning],
    queryFn: ({ signal }) => answered(api.GET("/api/tuning/preview", { params: { query: wanted }, signal })),
    placeholderData: (before) => before,
    staleTime: 60_000,
  });
}

/** M_s and margins of the motor loops at a λ_motor; `bank` is the one in force, for another may have other motors. */
export function motorMarginsQuery(lam_motor: number, bank: number | null) {
  return queryOptions({
    queryKey: ["tuning", "motor", lam_motor, bank],
    queryFn: () => answered(api.GET("/api/tuning/motor", { params: { query: { lam_motor } } })),
    staleTime: 60_000,
    retry: false,
  });
}

/** What was saved for a bank; `bank` is null while the gains come from geometry. */
export function savedTuningQuery(bank: number | null) {
  return queryOptions({
    queryKey: ["tuning", "saved", bank],
    refetchInterval: OTHERS_MS,
    queryFn: () => answered(api.GET("/api/tuning/saved")),
  });
}

/** The tuning in force as a word: gains, M_s and previews are asked for again when any part of it changes. */
export function tuningKey(tuning: Tuning | undefined): string {
  if (tuning === undefined) return "";
  const { lam_q, lam_S, lam_motor, b, interpolate, motion, u_plan, k_ext, bank, entry } = tuning;
  return [lam_q, lam_S, lam_motor, b, interpolate, motion, u_plan, k_ext, bank?.id, Math.round(entry)].join(
    " ",
  );
}

export function useSetTuning() {
  return useMutation({ mutationFn: (body: TuningRequest) => answered(api.PUT("/api/tuning", { body })) });
}

export function useTryTuning() {
  return useMutation({
    mutationFn: (body: TuningRequest & { duration_s: number }) =>
      answered(api.POST("/api/tuning/trial", { body })),
  });
}

/** Ends a trial: keeps what is tried, or puts the earlier tuning back at once. */
export function useEndTrial() {
  return useMutation({
    mutationFn: (keep: boolean) =>
      answered(keep ? api.POST("/api/tuning/trial/keep") : api.DELETE("/api/tuning/trial")),
  });
}

export function useSaveTuning() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.PUT("/api/tuning/saved")),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["tuning", "saved"] }),
  });
}

/** Undoes the last change of what is in force, or does again what was undone last. */
export function useTuningStep(step: "undo" | "redo") {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.POST(`/api/tuning/${step}`)),
    onSuccess: () =>
      Promise.all(["banks", "tuning"].map((key) => queries.invalidateQueries({ queryKey: [key] }))),
  });
}

/** Which changes of the tuning the service would refuse at present, and why. Pure. */

export const ON_TRIAL = TEXTS.onTrial;

/** Why the tuning cannot be changed, by whatever part of it; null where it can. `noControl` says who holds control. */
export function whyNoRetuning(state: State | null, noControl: string | null): string | null {
  if (noControl !== null) return noControl;
  if (state?.own_tuning == null) return null;
  return state.task === null
    ? TEXTS.tuningLockedAtStart
    : fillText(TEXTS.tuningLocked, { run: state.task.run });
}

/** Why pushes cannot be rejected; null where they can: what is estimated at rest has to be known, and to be quiet. */
export function whyNoEstimate(state: State | null): string | null {
  const deviations = state?.touch.learned.map(({ std_N }) => std_N) ?? [];
  if (deviations.length === 0) return TEXTS.notCalibrated;
  const noise = Math.max(...deviations);
  const most = UNSEEN_F / DEVIATIONS;
  if (noise <= most) return null;
  const digits = digitsApart([noise, most], 2);
  return fillText(TEXTS.estimateNoisy, { noise: short(noise, digits), limit: short(most, digits) });
}

/** Why a tuning cannot come into force for what it rejects; null where it can, or rejects nothing. */
export function whyNoRejection(state: State | null, k_ext: number | undefined): string | null {
  const reason = k_ext ? whyNoEstimate(state) : null;
  return reason === null ? null : fillText(TEXTS.rejects, { reason });
}

/** Why the last change cannot be undone, or done again; null where it can. */
export function whyNoStep(
  step: "undo" | "redo",
  state: State | null,
  noControl: string | null,
): string | null {
  const tuning = step === "undo" ? state?.earlier : state?.later;
  if (state === null || tuning == null) {
    return step === "undo" ? TEXTS.nothingToUndo : TEXTS.nothingToRedo;
  }
  if (state.trial !== null) return ON_TRIAL;
  return whyNoRetuning(state, noControl) ?? whyNoRejection(state, tuning.k_ext);
}

/** A tuning in words: the λ, b, and the bank whose models it is applied to. Pure. */

const LAMBDAS = [
  ["lam_q", "λ_q"],
  ["lam_S", "λ_S"],
  ["lam_motor", "λ_motor"],
] as const;

/** The tuning of an order or a run in one line: "λ_q 0.5 s, …, geometric gains". */
export function describeTuning(settings: Readonly<Record<string, unknown>>, banks: readonly Bank[]): string {
  const parts = [
    ...LAMBDAS.map(([name, symbol]) => partOf(settings[name], symbol, TEXTS.time)),
    settings.b === undefined ? TEXTS.bNotRecorded : partOf(settings.b, "b", TEXTS.quantity),
    describeBank(settings.bank, banks),
    settings.interpolate === true ? TEXTS.interpolated : "",
    describeMotion(settings.motion, settings.u_plan),
    describeFeedforward(settings.k_ext),
  ];
  return parts.filter((part) => part !== "").join(", ");
}

export function describeBank(id: unknown, banks: readonly Bank[]): string {
  if (typeof id !== "number") return "";
  if (id === 0) return TEXTS.geometricGains;
  const bank = banks.find((one) => one.id === id);
  return bank === undefined
    ? fillText(TEXTS.bankNumber, { number: id })
    : fillText(TEXTS.bank, { name: bank.name, version: bank.version });
}

/** How references are followed; runs recorded before motions had names have a voltage limit in one of them only. */
export function describeMotion(motion: unknown, u_plan: unknown): string {
  const isTimeOptimal = motion === undefined ? Number(u_plan ?? 0) > 0 : motion === "time-optimal";
  if (!isTimeOptimal) return TEXTS.lambdaMotion;
  return typeof u_plan === "number"
    ? fillText(TEXTS.timeOptimalWithin, { limit: short(u_plan) })
    : TEXTS.timeOptimal;
}

/** How much of a push is fed forward; nothing where that is left to the position loop, as it ever was. */
function describeFeedforward(k_ext: unknown): string {
  return typeof k_ext === "number" && k_ext > 0 ? fillText(TEXTS.rejection, { gain: short(k_ext) }) : "";
}

function partOf(value: unknown, symbol: string, text: typeof TEXTS.quantity | typeof TEXTS.time): string {
  return typeof value === "number" ? fillText(text, { symbol, value: short(value) }) : "";
}

/** λ that were chosen but not sent: kept in the browser, so that a reload or a lost link does not lose them. */

export type LambdaName = "lam_q" | "lam_S";
type StagedLambdas = Partial<Record<LambdaName, number>>;

interface Staged {
  /** Whether changes are gathered instead of being sent. */
  readonly staging: boolean;
  readonly values: StagedLambdas;
}

const NOTHING: Staged = { staging: false, values: {} };

export interface Staging extends Staged {
  turn(on: boolean): void;
  stage(name: LambdaName, value: number): void;
  discard(): void;
}

export function useStagedTuning(): Staging {
  const [staged, set] = useLocalStorage<Staged>({
    key: "sinew-staged-tuning",
    defaultValue: NOTHING,
    getInitialValueInEffect: false,
    deserialize: (text) => parsed(text),
  });
  return {
    ...staged,
    turn: (staging) => set({ staging, values: {} }),
    stage: (name, value) => set((before) => ({ ...before, values: { ...before.values, [name]: value } })),
    discard: () => set((before) => ({ ...before, values: {} })),
  };
}

/** What another version of the page may have left is not trusted. */
function parsed(text: string | undefined): Staged {
  try {
    const { staging, values } = JSON.parse(text ?? "") as Staged;
    const numbers = Object.entries(values).filter(([, value]) => Number.isFinite(value));
    return { staging: staging === true, values: Object.fromEntries(numbers) };
  } catch {
    return NOTHING;
  }
}

/** What a tuning in hand would do, and whether the numbers at hand already belong to it. */

/** How long a value has to rest before it is asked for: a drag changes it with each frame. */
const AFTER_MS = 60;
/** How finely the stiffness of the preview follows the reference [N·m/rad], and a joint that has none. */
const COMMANDED_STEP = 0.01;
const MEASURED_STEP = 0.5;

export interface Previewed {
  readonly preview: TuningPreview | undefined;
  /** The numbers belong to an earlier value: those of this one are being computed. */
  readonly stale: boolean;
  /** Why there is no preview where there is none. */
  readonly missing: string;
}

export function usePreview(wanted: PreviewRequest, tuning: Tuning): Previewed {
  const key = JSON.stringify(wanted);
  const [asked] = useDebouncedValue(key, AFTER_MS);
  const query = useQuery(previewQuery(JSON.parse(asked) as PreviewRequest, restOf(tuning)));
  const stale = asked !== key || query.isPlaceholderData;
  if (query.error !== null && asked === key)
    return { preview: undefined, stale: false, missing: query.error.message };
  return { preview: query.data, stale: stale && query.data !== undefined, missing: "computing" };
}

/** What a preview depends on beside its request: another one has another preview. */
function restOf({ lam_motor, b, interpolate, bank, entry }: Tuning): string {
  return [lam_motor, b, interpolate, bank?.id, Math.round(entry)].join(" ");
}

/** Stiffness that a preview is for: that of the reference, within its range; undefined before the first state. */
export function usePreviewedStiffness(): number | undefined {
  return useLive((live) => {
    if (live.state === null) return undefined;
    const { S_ref, in_force } = live.state.references;
    const { S_min, S_max } = live.state.limits;
    const step = in_force ? COMMANDED_STEP : MEASURED_STEP;
    return Math.min(Math.max(Number((Math.round((S_ref ?? S_min) / step) * step).toFixed(2)), S_min), S_max);
  });
}
