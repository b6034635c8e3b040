/** Asks again for lists and results when something has happened that changes them. */

import { useQueryClient } from "@tanstack/react-query";
import { useEffect } from "react";
import { useLive } from "../live/react";

const CHANGED_BY_TASKS = ["identifications", "experiments", "runs", "banks", "queue", "checklist"] as const;
/** After so many failed connections the reason may be that the session has ended. */
const FAILURES = 2;

export function useFreshness(): void {
  const queries = useQueryClient();
  const task = useLive((live) => live.state?.task?.run ?? null);
  const recording = useLive((live) => live.state?.recording_run ?? null);
  const failing = useLive((live) => live.link.failures >= FAILURES);

  // biome-ignore lint/correctness/useExhaustiveDependencies: the begin and the end of a task or a recording are the reason
  useEffect(() => {
    for (const key of CHANGED_BY_TASKS) void queries.invalidateQueries({ queryKey: [key] });
  }, [queries, task, recording]);

  useEffect(() => {
    if (failing) void queries.invalidateQueries({ queryKey: ["session"] });
  }, [queries, failing]);
}
