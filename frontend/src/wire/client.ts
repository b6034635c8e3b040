/** The REST client, typed by the service's own schema, and the one shape in which it fails. */

import createClient from "openapi-fetch";
import { BASE } from "./address";
import type { paths } from "./api.gen";
import { controlledFetch } from "./control";
import type { Problem } from "./types";

export const api = createClient<paths>({
  baseUrl: BASE,
  credentials: "same-origin",
  fetch: controlledFetch,
});

/** A request that was refused or did not get through; the message can be shown as it is. */
export class RequestError extends Error {
  override readonly name = "RequestError";

  constructor(
    message: string,
    /** HTTP status, 0 when no answer came. */
    readonly status: number,
    readonly problem: Problem | null = null,
  ) {
    super(message);
  }
}

interface Answer<Data> {
  data?: Data;
  error?: unknown;
  response: Response;
}

/** The data of an answer. Throws RequestError for refusals and when the service cannot be reached. */
export async function answered<Data>(request: Promise<Answer<Data>>): Promise<Data> {
  let answer: Answer<Data>;
  try {
    answer = await request;
  } catch {
    throw new RequestError(
      "The service cannot be reached. Nothing was changed as far as this page knows.",
      0,
    );
  }
  if (answer.error === undefined && answer.response.ok) return answer.data as Data;
  const problem = problemIn(answer.error);
  throw new RequestError(
    problem?.message ?? `The service answered ${answer.response.status}.`,
    answer.response.status,
    problem,
  );
}

/** A bare answer in the same shape. Throws RequestError. */
export function answeredBy(request: Promise<Response>): Promise<unknown> {
  const parsed = async () => {
    const response = await request;
    const body: unknown = response.status === 204 ? undefined : await response.json();
    return response.ok ? { data: body, response } : { error: body, response };
  };
  return answered(parsed());
}

function problemIn(body: unknown): Problem | null {
  if (typeof body !== "object" || body === null || !("error" in body)) return null;
  const problem = body.error;
  if (typeof problem !== "object" || problem === null || !("message" in problem)) return null;
  return problem as Problem;
}

/** Lines of JSON that the service sends while it works: how far it is, and the result in the last one. */

interface Line<Result> {
  readonly share: number;
  readonly result?: Result | null;
}

/** The result of such an answer. Throws Error where the answer ends without one; rejects when the request is aborted. */
export async function resultIn<Result>(
  body: ReadableStream<Uint8Array>,
  onShare: (share: number) => void,
): Promise<Result> {
  const reader = body.getReader();
  const decoder = new TextDecoder();
  let rest = "";
  for (;;) {
    const { value, done } = await reader.read();
    const lines = (rest + decoder.decode(value, { stream: !done })).split("\n");
    rest = lines.pop() ?? "";
    for (const line of lines) {
      const { share, result } = JSON.parse(line) as Line<Result>;
      onShare(share);
      if (result) return result;
    }
    if (done) throw new Error("The service ended its answer before the result. Try again.");
  }
}
