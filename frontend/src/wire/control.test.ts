// @vitest-environment jsdom
import { afterEach, beforeEach, expect, it, vi } from "vitest";

type Control = typeof import("./control");

const fetched = vi.fn<(request: Request) => Promise<Response>>();

function answer(status: number, body: unknown): Response {
  return new Response(JSON.stringify(body), { status });
}

function refusal(code: string): Response {
  return answer(409, { error: { code, message: code } });
}

function command(): Request {
  return new Request("http://localhost/api/mode", { method: "POST", body: '{"mode":"run"}' });
}

/** The module as a page loads it: what is held comes from the tab's storage. */
async function load(): Promise<Control> {
  vi.resetModules();
  return import("./control");
}

function sent(): string[] {
  return fetched.mock.calls.map(
    ([r]) => `${r.method} ${new URL(r.url).pathname} ${r.headers.get("Sinew-Control")}`,
  );
}

beforeEach(() => {
  vi.stubGlobal("fetch", fetched);
  sessionStorage.clear();
});

afterEach(() => {
  fetched.mockReset();
  vi.unstubAllGlobals();
});

it("takes control with its first command where nobody holds it", async () => {
  const control = await load();
  fetched
    .mockResolvedValueOnce(answer(200, { epoch: 7, name: "Ana" }))
    .mockResolvedValueOnce(answer(200, {}));
  expect((await control.controlledFetch(command())).ok).toBe(true);
  expect(sent()).toEqual(["POST /api/control null", "POST /api/mode 7.1"]);
  expect(await fetched.mock.calls[0]?.[0].text()).toBe('{"take_over":false}');
  expect(control.heldEpoch()).toBe(7);
});

it("never takes over from somebody by itself, and sends no command then", async () => {
  const control = await load();
  fetched.mockResolvedValueOnce(refusal("control_held"));
  expect((await control.controlledFetch(command())).status).toBe(409);
  expect(sent()).toEqual(["POST /api/control null"]);
  expect(control.heldEpoch()).toBeNull();
});

it.each(["/api/stop", "/api/identifications/prediction", "/api/session", "/api/preferences"])(
  "asks for no control for %s",
  async (path) => {
    const control = await load();
    fetched.mockResolvedValueOnce(answer(200, {}));
    await control.controlledFetch(new Request(`http://localhost${path}`, { method: "POST" }));
    expect(sent()).toEqual([`POST ${path} null`]);
  },
);

it("lets go of control that was taken over, and repeats nothing", async () => {
  sessionStorage.setItem("sinew-control", '{"epoch":7,"sequence":3}');
  const control = await load();
  fetched.mockResolvedValueOnce(refusal("control_lost"));
  expect((await control.controlledFetch(command())).status).toBe(409);
  expect(sent()).toEqual(["POST /api/mode 7.4"]);
  expect(control.heldEpoch()).toBeNull();
});

it("goes on holding control after a reload, with sequences that were never used", async () => {
  sessionStorage.setItem("sinew-control", '{"epoch":7,"sequence":3}');
  const control = await load();
  fetched.mockImplementation(async () => answer(200, {}));
  await control.controlledFetch(command());
  await (await load()).controlledFetch(command());
  expect(sent()).toEqual(["POST /api/mode 7.4", "POST /api/mode 7.5"]);
});
