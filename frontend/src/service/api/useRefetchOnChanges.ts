/** Fetches lists and results again when the live state shows that they may have changed. */

import { useQueryClient } from "@tanstack/react-query";
import { useEffect } from "react";
import { useLive } from "../../live/react";
import { RESTS_ON_PARAMETERS } from "./identifications";

const CHANGED_BY_TASKS = ["identifications", "experiments", "runs", "banks", "queue", "checklist"] as const;
/** After this number of failed connections, the session may have ended. */
const FAILURES = 2;

export function useRefetchOnChanges(): void {
  const queries = useQueryClient();
  const task = useLive((live) => live.state?.task?.run ?? null);
  const recording = useLive((live) => live.state?.recording_run ?? null);
  const starts = useLive((live) => live.state?.link.starts ?? null);
  const bank = useLive((live) => live.state?.tuning.bank?.id ?? null);
  const failing = useLive((live) => live.link.failures >= FAILURES);

  // biome-ignore lint/correctness/useExhaustiveDependencies: the start and the end of a task or a recording trigger the effect
  useEffect(() => {
    for (const key of CHANGED_BY_TASKS) void queries.invalidateQueries({ queryKey: [key] });
  }, [queries, task, recording]);

  // applied parameters become active with a new loop process
  useEffect(() => {
    if (starts === null) return;
    for (const key of RESTS_ON_PARAMETERS) void queries.invalidateQueries({ queryKey: [key] });
  }, [queries, starts]);

  // biome-ignore lint/correctness/useExhaustiveDependencies: another active bank triggers the effect
  useEffect(() => {
    for (const key of ["banks", "tuning"]) void queries.invalidateQueries({ queryKey: [key] });
  }, [queries, bank]);

  useEffect(() => {
    if (failing) void queries.invalidateQueries({ queryKey: ["session"] });
  }, [queries, failing]);
}
