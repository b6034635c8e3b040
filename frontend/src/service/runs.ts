import { queryOptions, useMutation } from "@tanstack/react-query";
import { paintsInSoftware } from "../drawing/canvas";
import type { Stretch } from "../samples/timeSeries";
import type { operations } from "../wire/api.gen";
import { answered, api } from "../wire/client";
import { excerptOf } from "../wire/curves";
import type { Differences, PlayerOrder } from "../wire/types";
import { usePreferences } from "./preferences";

/** Runs beside each other: their metrics and settings, their differences, and both as files. */

type Asked = operations["compare_runs"]["parameters"]["query"];

/** Which runs, beside which of them, aligned by what. */
export type ComparisonAsked = Required<Asked> & { readonly reference: number };

export function comparisonQuery(query: ComparisonAsked) {
  return queryOptions({
    queryKey: ["runs", "comparison", query],
    queryFn: () => answered(api.GET("/api/run-comparison", { params: { query } })),
    placeholderData: (before) => before,
  });
}

/** Of a signal over a stretch of the reference; `band` is null where no tolerance is given. */
export function differencesQuery(
  asked: ComparisonAsked,
  signal: string,
  band: number | null,
  points: number,
  stretch?: Stretch,
) {
  const query = { ...asked, signal, points, ...(band === null ? {} : { band }), ...stretch };
  return queryOptions({
    queryKey: ["runs", "differences", query],
    queryFn: () => answered(api.GET("/api/run-comparison/differences", { params: { query } })),
    staleTime: Number.POSITIVE_INFINITY,
    gcTime: 60_000,
  });
}

/** The differences as curves, each called as `named` says; without those that have no name. */
export function curvesOf(found: Differences, named: (run: number) => string | null) {
  const signals = found.runs.flatMap(({ run, minimum, maximum }) => {
    const name = named(run);
    return name === null ? [] : [[name, { unit: found.unit, minimum, maximum }]];
  });
  return excerptOf({ ...found, run: found.reference, signals: Object.fromEntries(signals) });
}

/** Where the comparison is had as text. */
export function comparisonFile(content: "curves" | "table", asked: ComparisonAsked, signal: string): string {
  const { run, ...rest } = asked;
  const words = [...run.map((one) => ["run", one]), ...Object.entries(rest), ["signal", signal]];
  return `./api/run-comparison/${content}.csv?${words.map(([name, value]) => `${name}=${value}`).join("&")}`;
}

/** The recording that is played in place of a plant: what is in it, and what its player is told. */

/** What is played does not change as long as the service runs. */
export const playedQuery = queryOptions({
  queryKey: ["player"],
  queryFn: () => answered(api.GET("/api/player")),
  staleTime: Number.POSITIVE_INFINITY,
  retry: false,
});

/** Plays, pauses, sets the speed or goes to a time; what is left out stays as it is. */
export function usePlayer() {
  return useMutation({
    mutationFn: (body: Partial<PlayerOrder>) => answered(api.PUT("/api/player", { body })),
  });
}

/** Whether a person sees the actuator in 3D, and from where: remembered for them, at every machine. */

interface SceneView {
  readonly solid: boolean;
  readonly camera: string;
  /** False until it is known what the person chose before: nothing can be changed until then. */
  readonly known: boolean;
  toggle(): void;
  look(camera: string): void;
}

/**
 * `byDefault` is what somebody sees who never chose. The 3D view shares the page's thread: what was chosen where there
 * is a graphics processor does not count where there is none, for it would hold up STOP there.
 */
export function useSceneView(byDefault: boolean): SceneView {
  const { preferences, known, change } = usePreferences();
  const chosen = paintsInSoftware() ? "solid_unaided" : "solid";
  const solid = known && (preferences[chosen] ?? (byDefault && !paintsInSoftware()));
  return {
    solid,
    camera: preferences.camera,
    known,
    toggle: () => change({ [chosen]: !solid }),
    look: (camera) => change({ camera }),
  };
}
