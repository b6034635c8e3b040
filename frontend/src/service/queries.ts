/** Everything that is read from the service by asking, with one key per thing. */

import { queryOptions, skipToken } from "@tanstack/react-query";
import type { Stretch } from "../samples/timeSeries";
import { answered, api } from "../wire/client";
import { decodeCurves } from "../wire/curves";
import type { IdentificationRequest, Tuning } from "../wire/types";

/** How often the page asks again for what another person may change and the state does not tell [ms]. */
const OTHERS_MS = 3000;
const WHILE_RUNNING_MS = 700;

/** End states of the service, beside which a run is still going. */
export function isRunning(status: string): boolean {
  return status === "running";
}

export const sessionQuery = queryOptions({
  queryKey: ["session"],
  queryFn: () => answered(api.GET("/api/session")),
  retry: false,
});

export const healthQuery = queryOptions({
  queryKey: ["health"],
  queryFn: () => answered(api.GET("/api/health")),
});

/** What a preview is asked for; the rest of the tuning is that in use. */
export interface PreviewRequest {
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
export function previewQuery(wanted: PreviewRequest, tuning: string) {
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

export const identificationsQuery = queryOptions({
  queryKey: ["identifications"],
  queryFn: async () => (await answered(api.GET("/api/identifications"))).identifications,
});

export function identificationQuery(id: number) {
  return queryOptions({
    queryKey: ["identifications", id],
    queryFn: () => answered(api.GET("/api/identifications/{id}", { params: { path: { id } } })),
    refetchInterval: (query) => (isRunning(query.state.data?.status ?? "") ? WHILE_RUNNING_MS : false),
  });
}

export const identificationKindsQuery = queryOptions({
  queryKey: ["identification-kinds"],
  queryFn: async () => (await answered(api.GET("/api/identification-kinds"))).kinds,
  staleTime: Number.POSITIVE_INFINITY,
});

export function curvesQuery(id: number) {
  return queryOptions({
    queryKey: ["identifications", id, "curves"],
    queryFn: () => answered(api.GET("/api/identifications/{id}/curves", { params: { path: { id } } })),
    staleTime: Number.POSITIVE_INFINITY,
  });
}

export const springTablesQuery = queryOptions({
  queryKey: ["spring-tables"],
  queryFn: async () => (await answered(api.GET("/api/spring-tables"))).tables,
});

export function springTableCurvesQuery(id: number) {
  return queryOptions({
    queryKey: ["spring-tables", id, "curves"],
    queryFn: () => answered(api.GET("/api/spring-tables/{id}/curves", { params: { path: { id } } })),
    staleTime: Number.POSITIVE_INFINITY,
  });
}

/** `body` is null while the form holds no order; `from` says from where: elsewhere it is told anew. */
export function predictionQuery(body: IdentificationRequest | null, from: string) {
  return queryOptions({
    queryKey: ["prediction", body, from],
    queryFn:
      body === null ? skipToken : () => answered(api.POST("/api/identifications/prediction", { body })),
    placeholderData: (before) => before,
    staleTime: 60_000,
    retry: false,
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

/** What identifying one point again would change about the models in use. */
export function differenceInUseQuery(run: number, lambdas: string) {
  return queryOptions({
    queryKey: ["banks", "in-use", "difference", run, lambdas],
    queryFn: () => answered(api.GET("/api/banks/in-use/difference", { params: { query: { run: [run] } } })),
  });
}

export function bankDifferenceQuery(id: number, other: number, lambdas: string) {
  return queryOptions({
    queryKey: ["banks", id, "difference", other, lambdas],
    queryFn: () =>
      answered(api.GET("/api/banks/{id}/difference", { params: { path: { id }, query: { other } } })),
  });
}

export function bankDetailQuery(id: number, lambdas: string) {
  return queryOptions({
    queryKey: ["banks", id, "detail", lambdas],
    queryFn: () => answered(api.GET("/api/banks/{id}/detail", { params: { path: { id } } })),
    placeholderData: (before) => before,
  });
}

export const banksQuery = queryOptions({
  queryKey: ["banks"],
  refetchInterval: OTHERS_MS,
  queryFn: async () => (await answered(api.GET("/api/banks"))).banks,
});

export const experimentKindsQuery = queryOptions({
  queryKey: ["experiment-kinds"],
  queryFn: async () => (await answered(api.GET("/api/experiments"))).experiments,
  staleTime: Number.POSITIVE_INFINITY,
});

export const queueQuery = queryOptions({
  queryKey: ["queue"],
  refetchInterval: OTHERS_MS,
  queryFn: () => answered(api.GET("/api/experiments/queue")),
});

export function experimentQuery(id: number) {
  return queryOptions({
    queryKey: ["experiments", id],
    queryFn: () => answered(api.GET("/api/experiments/{id}", { params: { path: { id } } })),
    refetchInterval: (query) => (isRunning(query.state.data?.status ?? "") ? WHILE_RUNNING_MS : false),
  });
}

export interface RunFilter {
  /** Kinds with commas between; of all where there is none. */
  readonly kind?: string;
  /** Words that stand somewhere. */
  readonly search?: string;
  /** Searches, all of which have to fit; empty ones ask nothing. */
  readonly where?: readonly string[];
  readonly limit: number;
  readonly offset: number;
}

export function runsQuery(filter: RunFilter) {
  const { kind = "", search = "", where = [], limit, offset } = filter;
  const asked = where.filter((part) => part.trim() !== "");
  const query = {
    limit,
    offset,
    ...(kind === "" ? {} : { kind }),
    ...(search === "" ? {} : { search }),
    ...(asked.length === 0 ? {} : { where: asked }),
  };
  return queryOptions({
    queryKey: ["runs", filter],
    queryFn: () => answered(api.GET("/api/runs", { params: { query } })),
    placeholderData: (before) => before,
    retry: false,
  });
}

export function runQuery(id: number) {
  return queryOptions({
    queryKey: ["runs", id],
    queryFn: () => answered(api.GET("/api/runs/{id}", { params: { path: { id } } })),
    refetchInterval: ({ state: { data } }) =>
      isRunning(data?.end_state ?? "") || data?.evaluation === "under_way" ? 2000 : false,
  });
}

export function lineageQuery(id: number) {
  return queryOptions({
    queryKey: ["runs", id, "lineage"],
    queryFn: () => answered(api.GET("/api/runs/{id}/lineage", { params: { path: { id } } })),
  });
}

export const searchWordsQuery = queryOptions({
  queryKey: ["runs", "words"],
  queryFn: () => answered(api.GET("/api/run-words")),
});

export const savedSearchesQuery = queryOptions({
  queryKey: ["saved-searches"],
  queryFn: async () => (await answered(api.GET("/api/saved-searches"))).searches,
});

/** `metric` "" is the first there is. */
export function metricHistoryQuery(kind: string, metric: string, where: string, everywhere: boolean) {
  return queryOptions({
    queryKey: ["runs", "metric-history", kind, metric, where, everywhere],
    queryFn: () =>
      answered(api.GET("/api/metric-history", { params: { query: { kind, metric, where, everywhere } } })),
    placeholderData: (before) => before,
    retry: false,
  });
}

/** What a run was to follow; `recorded`: its first samples are stored, from which it is known where it began. */
export function plannedQuery(id: number, recorded: boolean) {
  return queryOptions({
    queryKey: ["runs", id, "planned", recorded],
    queryFn: () => answered(api.GET("/api/runs/{id}/planned", { params: { path: { id } } })),
    placeholderData: (before) => before,
    staleTime: Number.POSITIVE_INFINITY,
  });
}

export function runMarksQuery(id: number) {
  return queryOptions({
    queryKey: ["runs", id, "marks"],
    queryFn: async () =>
      (await answered(api.GET("/api/runs/{id}/marks", { params: { path: { id } } }))).marks,
  });
}

export const checklistQuery = queryOptions({
  queryKey: ["checklist"],
  queryFn: async () => (await answered(api.GET("/api/checklist"))).steps,
});

export function recordingQuery(id: number, stretch: Stretch, points: number, signals: readonly string[]) {
  const query = { from: stretch.from_s, to: stretch.to_s, points, signals: signals.join(",") };
  return queryOptions({
    queryKey: ["runs", id, "samples", query],
    queryFn: async () => {
      const params = { path: { id }, query };
      const message = await answered(
        api.GET("/api/runs/{id}/samples.bin", { params, parseAs: "arrayBuffer" }),
      );
      return decodeCurves(message, signals);
    },
    staleTime: Number.POSITIVE_INFINITY,
    gcTime: 60_000,
  });
}
