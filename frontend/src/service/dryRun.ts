/** A dry run: played beside the service while the connection that asked for it stands. */

import { queryOptions, useMutation } from "@tanstack/react-query";
import { useEffect, useRef } from "react";
import { answered, api } from "../wire/client";
import type { SettingValues } from "./commands";

/** How far one's own dry run is; asked for while the page shows it. */
export const dryRunProgressQuery = queryOptions({
  queryKey: ["dry-run-progress"],
  queryFn: () => answered(api.GET("/api/experiments/dry-run/progress")),
  refetchInterval: 500,
  gcTime: 0,
});

/** A dry run that can be cancelled; it ends with its connection, also where the page is left. */
export function useDryRun() {
  const connection = useRef<AbortController | null>(null);
  const dryRun = useMutation({
    mutationFn: (body: { name: string; settings: SettingValues }) => {
      connection.current = new AbortController();
      const { signal } = connection.current;
      return answered(api.POST("/api/experiments/dry-run", { body, signal }));
    },
  });
  useEffect(() => () => connection.current?.abort(), []);
  function cancel(): void {
    connection.current?.abort();
    dryRun.reset();
  }
  return { ...dryRun, cancel };
}
