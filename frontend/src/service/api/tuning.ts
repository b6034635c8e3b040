/** The tuning: queries, changes, trials, undo; reasons why the service refuses a change, and descriptions. */

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

/** Tuning of a preview; its other parameters are those of the active tuning. */
interface PreviewRequest {
  readonly lam_q: number;
  readonly lam_S: number;
  readonly motion: Tuning["motion"];
  readonly u_plan: number;
  readonly k_ext: number;
  /** Undefined for the stiffness of the current reference. */
  readonly S: number | undefined;
  /** Whether to add the result of the published formula (erratum E1). */
  readonly printed: boolean;
}

/** `tuning` identifies the rest of the active tuning: another one has another preview. */
function previewQuery(wanted: PreviewRequest, tuning: string) {
  return queryOptions({
    queryKey: ["tuning", "preview", wanted, tuning],
    queryFn: ({ signal }) => answered(api.GET("/api/tuning/preview", { params: { query: wanted }, signal })),
    placeholderData: (before) => before,
    staleTime: 60_000,
  });
}

/** Fetches M_s and margins of the motor loops at a λ_motor; `bank` is the active one: banks may have other motors. */
export function motorMarginsQuery(lam_motor: number, bank: number | null) {
  return queryOptions({
    queryKey: ["tuning", "motor", lam_motor, bank],
    queryFn: () => answered(api.GET("/api/tuning/motor", { params: { query: { lam_motor } } })),
    staleTime: 60_000,
    retry: false,
  });
}

/** Fetches the saved tuning of a bank; `bank` is null for geometric gains. */
export function savedTuningQuery(bank: number | null) {
  return queryOptions({
    queryKey: ["tuning", "saved", bank],
    refetchInterval: OTHERS_MS,
    queryFn: () => answered(api.GET("/api/tuning/saved")),
  });
}

/** Returns a key of the active tuning: the page fetches gains, M_s and previews again when it changes. */
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

/** Ends a trial: keeps its tuning, or reverts to the previous one at once. */
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

/** Undoes the last change of the active tuning, or redoes the last undone one. */
export function useTuningStep(step: "undo" | "redo") {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.POST(`/api/tuning/${step}`)),
    onSuccess: () =>
      Promise.all(["banks", "tuning"].map((key) => queries.invalidateQueries({ queryKey: [key] }))),
  });
}

export const ON_TRIAL = TEXTS.onTrial;

/** Returns why no part of the tuning can change; null if it can. `noControl` names the holder of the control lease. */
export function whyNoRetuning(state: State | null, noControl: string | null): string | null {
  if (noControl !== null) return noControl;
  if (state?.own_tuning == null) return null;
  return state.task === null
    ? TEXTS.tuningLockedAtStart
    : fillText(TEXTS.tuningLocked, { run: state.task.run });
}

/** Returns why disturbance rejection is unavailable; null if the bias is calibrated and the estimate has low noise. */
export function whyNoEstimate(state: State | null): string | null {
  const deviations = state?.touch.learned.map(({ std_N }) => std_N) ?? [];
  if (deviations.length === 0) return TEXTS.notCalibrated;
  const noise = Math.max(...deviations);
  const most = UNSEEN_F / DEVIATIONS;
  if (noise <= most) return null;
  const digits = digitsApart([noise, most], 2);
  return fillText(TEXTS.estimateNoisy, { noise: short(noise, digits), limit: short(most, digits) });
}

/** Returns why the disturbance rejection of a tuning cannot be applied; null if it can, or if the tuning has none. */
export function whyNoRejection(state: State | null, k_ext: number | undefined): string | null {
  const reason = k_ext ? whyNoEstimate(state) : null;
  return reason === null ? null : fillText(TEXTS.rejects, { reason });
}

/** Returns why the last change cannot be undone or redone; null if it can. */
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

const LAMBDAS = [
  ["lam_q", "λ_q"],
  ["lam_S", "λ_S"],
  ["lam_motor", "λ_motor"],
] as const;

/** Describes the tuning of a run in one line: "λ_q 0.5 s, …, geometric gains". */
export function describeTuning(settings: Readonly<Record<string, unknown>>, banks: readonly Bank[]): string {
  const parts = [
    ...LAMBDAS.map(([name, symbol]) => describeParameter(settings[name], symbol, TEXTS.time)),
    settings.b === undefined ? TEXTS.bNotRecorded : describeParameter(settings.b, "b", TEXTS.quantity),
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

/** Describes the motion; runs without a stored motion are time-optimal if they have a voltage limit. */
export function describeMotion(motion: unknown, u_plan: unknown): string {
  const isTimeOptimal = motion === undefined ? Number(u_plan ?? 0) > 0 : motion === "time-optimal";
  if (!isTimeOptimal) return TEXTS.lambdaMotion;
  return typeof u_plan === "number"
    ? fillText(TEXTS.timeOptimalWithin, { limit: short(u_plan) })
    : TEXTS.timeOptimal;
}

/** Describes the disturbance rejection; "" without one. */
function describeFeedforward(k_ext: unknown): string {
  return typeof k_ext === "number" && k_ext > 0 ? fillText(TEXTS.rejection, { gain: short(k_ext) }) : "";
}

function describeParameter(
  value: unknown,
  symbol: string,
  text: typeof TEXTS.quantity | typeof TEXTS.time,
): string {
  return typeof value === "number" ? fillText(text, { symbol, value: short(value) }) : "";
}

/** λ of the staged tuning; stored in the browser, so that they survive a reload or a lost connection. */

export type LambdaName = "lam_q" | "lam_S";
type StagedLambdas = Partial<Record<LambdaName, number>>;

interface Staged {
  /** Whether the page collects changes instead of sending them. */
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
    deserialize: (text) => parseStaged(text),
  });
  return {
    ...staged,
    turn: (staging) => set({ staging, values: {} }),
    stage: (name, value) => set((before) => ({ ...before, values: { ...before.values, [name]: value } })),
    discard: () => set((before) => ({ ...before, values: {} })),
  };
}

/** Parses the stored value; another version of the page may have stored other data. */
function parseStaged(text: string | undefined): Staged {
  try {
    const { staging, values } = JSON.parse(text ?? "") as Staged;
    const numbers = Object.entries(values).filter(([, value]) => Number.isFinite(value));
    return { staging: staging === true, values: Object.fromEntries(numbers) };
  } catch {
    return NOTHING;
  }
}

/** Time without a change before the page requests a preview [ms]: a drag changes the value with each frame. */
const AFTER_MS = 60;
/** Resolution of the previewed stiffness [N·m/rad]: of an active reference, and without one. */
const COMMANDED_STEP = 0.01;
const MEASURED_STEP = 0.5;

export interface Previewed {
  readonly preview: TuningPreview | undefined;
  /** Whether the preview belongs to an earlier value, while the service computes the current one. */
  readonly stale: boolean;
  /** Reason for a missing preview. */
  readonly missing: string;
}

export function usePreview(wanted: PreviewRequest, tuning: Tuning): Previewed {
  const key = JSON.stringify(wanted);
  const [asked] = useDebouncedValue(key, AFTER_MS);
  const query = useQuery(previewQuery(JSON.parse(asked) as PreviewRequest, restKey(tuning)));
  const stale = asked !== key || query.isPlaceholderData;
  if (query.error !== null && asked === key)
    return { preview: undefined, stale: false, missing: query.error.message };
  return { preview: query.data, stale: stale && query.data !== undefined, missing: "computing" };
}

/** Returns a key of the parameters that affect a preview and that its request does not contain. */
function restKey({ lam_motor, b, interpolate, bank, entry }: Tuning): string {
  return [lam_motor, b, interpolate, bank?.id, Math.round(entry)].join(" ");
}

/** Returns the stiffness of the preview: the reference, within its range; undefined before the first state. */
export function usePreviewedStiffness(): number | undefined {
  return useLive((live) => {
    if (live.state === null) return undefined;
    const { S_ref, in_force } = live.state.references;
    const { S_min, S_max } = live.state.limits;
    const step = in_force ? COMMANDED_STEP : MEASURED_STEP;
    return Math.min(Math.max(Number((Math.round((S_ref ?? S_min) / step) * step).toFixed(2)), S_min), S_max);
  });
}
