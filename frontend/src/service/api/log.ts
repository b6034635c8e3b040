/** The log: events, and the remarks of people on them. */

import { infiniteQueryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import type { AngleUnit } from "../../samples/quantity";
import { answered, api } from "../../wire/client";
import type { LogEntry } from "../../wire/types";

export type LogKind = LogEntry["kind"];

/** Filter of the log: no kinds select all kinds; times in the format of the service, or "". */
export interface LogAsked {
  readonly kinds: readonly LogKind[];
  readonly words: string;
  readonly since: string;
  readonly before: string;
  /** Unit of the angles in the searched texts. */
  readonly angles: AngleUnit;
}

const PAGE = 100;
const POLL_MS = 2000;
/** A text search reads the whole log, which takes the service tenths of a second in a long log. */
const SEARCH_MS = 8000;

/** Fetches the log, newest first, page by page; polls for new entries while only the first page is loaded. */
export function logQuery(asked: LogAsked) {
  const poll_ms = asked.words === "" ? POLL_MS : SEARCH_MS;
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
    refetchInterval: ({ state }) => ((state.data?.pages.length ?? 1) === 1 ? poll_ms : false),
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
