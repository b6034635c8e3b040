import { expect, it, vi } from "vitest";
import { picture } from "./export";

// the REST client stores fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  return replacement;
});

const SHEET = '<svg xmlns="http://www.w3.org/2000/svg" width="180mm" height="90mm"></svg>';
const refused = (status: number, message: string) => async () =>
  Response.json({ error: { code: "refused", message } }, { status });

/** Message of a failed conversion to PDF. */
async function failureOf(answer: () => Promise<Response>): Promise<string> {
  fetched.mockImplementation(async ({ url }) => {
    const control = { epoch: 1, page: "k".repeat(16), name: "A. Operator" };
    return url.endsWith("/api/chart-sheet.pdf") ? answer() : Response.json(control);
  });
  return picture(SHEET, "pdf").then(
    () => "made",
    ({ message }: Error) => message,
  );
}

it.each([
  ["is too large", refused(413, "the body is larger than 2097152 bytes"), /too many curves/],
  ["could not be sent in time", () => Promise.reject(new TypeError("Failed to fetch")), /slow/],
])("states the remedy if a drawing %s", async (_, answer, why) => {
  const message = await failureOf(answer);
  expect(message).toMatch(why);
  expect(message).toContain("ide some signals, or save it as SVG");
});

it("shows the service's message for other errors", async () => {
  expect(await failureOf(refused(422, "this is not a chart sheet"))).toBe("this is not a chart sheet");
});
