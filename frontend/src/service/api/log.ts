/** The log: everything that happened, and what people say of it. */

import { infiniteQueryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import type { AngleUnit } from "../../samples/quantity";
import { answered, api } from "../../wire/client";
import type { LogEntry } from "../../wire/types";

/** The log: everything that happened, and what people say of it. */

export type LogKind = LogEntry["kind"];

/** What of it is asked for: all kinds where there are none; times as the service has them, or "". */
export interface LogAsked {
  readonly kinds: readonly LogKind[];
  readonly words: string;
  readonly since: string;
  readonly before: string;
  /** The unit in which the words were read. */
  readonly angles: AngleUnit;
}

const PAGE = 100;
const LOOK_MS = 2000;
/** Words are looked for in all that there is, which takes the service tenths of a second in a long log. */
const SEARCH_MS = 8000;

/** Newest first, a page after the other; the newest are looked for again as long as nothing older was asked for. */
export function logQuery(asked: LogAsked) {
  const look_ms = asked.words === "" ? LOOK_MS : SEARCH_MS;
  return infiniteQueryOptions({
    queryKey: ["log", asked],
    queryFn: ({ pageParam }) => {
      const before = pageParam || asked.before;
      const query = {
        kind: [...asked.kinds],
        words: asked.words,
        angles: asked.angles,
        limit: PAGE,
        ...(asked.since === "" ? {} : { since: asked.since }),
        ...(before === "" ? {} : { before }),
      };
      return answered(api.GET("/api/log", { params: { query } }));
    },
    initialPageParam: "",
    getNextPageParam: (page) => page.more_before,
    placeholderData: (shown) => shown,
    refetchInterval: ({ state }) => ((state.data?.pages.length ?? 1) === 1 ? look_ms : false),
    retry: false,
  });
}

interface Remark {
  readonly note: string;
  readonly tags: string[];
}

export function useRemark(event: number) {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: Remark) =>
      answered(api.PUT("/api/log/{id}/remark", { params: { path: { id: event } }, body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["log"] }),
  });
}
