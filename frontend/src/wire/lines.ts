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
