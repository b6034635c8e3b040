/** Whether the way from this page's address to the service is set up right. */

import { queryOptions } from "@tanstack/react-query";
import { BASE } from "../wire/address";
import { answered, api, RequestError } from "../wire/client";

export interface WayToService {
  /** What is wrong, and how to set it right, in sentences. */
  readonly problems: readonly string[];
  /** Whether the service itself has found nothing wrong: what does not work then is something else. */
  readonly isAnswered: boolean;
}

const AGAIN_MS = 10_000;

/** Asked at the start, and once more when the live connection does not come about. */
export const wayQuery = (isWithoutStream: boolean) =>
  queryOptions({
    queryKey: ["page-address", isWithoutStream],
    queryFn: () => wayOf(answered(api.POST("/api/page-address", { body: { url: `${BASE}/` } }))),
    staleTime: Number.POSITIVE_INFINITY,
    refetchInterval: ({ state }) => (state.data?.problems.length === 0 ? false : AGAIN_MS),
  });

/** What the answer to the question says; a service that cannot be reached is told elsewhere. */
export async function wayOf(asked: Promise<{ problems: { message: string }[] }>): Promise<WayToService> {
  try {
    const { problems } = await asked;
    return { problems: problems.map(({ message }) => message), isAnswered: true };
  } catch (error) {
    if (!(error instanceof RequestError) || error.status === 0) return { problems: [], isAnswered: false };
    return { problems: [error.problem?.message ?? notPassedOn(error.status)], isAnswered: false };
  }
}

function notPassedOn(status: number): string {
  const cookies = [400, 413, 431, 494].includes(status)
    ? " Where that is because of large cookies of other applications (nginx: large_client_header_buffers 4 32k;), raise its limit or delete the cookies of this site."
    : "";
  return `What answers at ${BASE}/api/ is not Sinew (status ${status}): the reverse proxy in front has to pass all paths below ${BASE}/ to the service.${cookies}`;
}

/** Said when requests are answered and the live connection never comes about. */
export const NO_STREAM =
  "Requests are answered, the live connection is not: a reverse proxy in front may not pass websockets on. " +
  'For nginx: proxy_http_version 1.1; proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection "upgrade"; ' +
  "The log of the service says more.";
