import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { TEXTS as SHARED } from "../../components/texts";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { fillText } from "../../samples/texts";
import type { State, Tuning } from "../../wire/types";
import { TuningChanges } from "./TuningCard";
import { TEXTS } from "./texts";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

const SAVED = {
  lam_q: 0.5,
  lam_S: 0.42,
  lam_motor: 0.0854,
  b: 0,
  interpolate: false,
  motion: "lambda",
  u_plan: 8.5,
  k_ext: 0,
};
const OTHER = {
  lam_q: 0.6,
  lam_S: 0.5,
  lam_motor: 0.09,
  b: 1,
  interpolate: true,
  motion: "time-optimal",
  u_plan: 6,
  k_ext: 0.7,
};
type Part = keyof typeof SAVED;

const NOTHING = { staging: false, values: {}, turn() {}, stage() {}, discard() {} };

function open(tuning: typeof SAVED, state: object | null = null): void {
  const store = new LiveStore(0);
  if (state !== null) store.setState({ link: { starts: 1 }, ...state } as unknown as State);
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient()}>
        <LiveProvider store={store}>
          <TuningChanges tuning={{ ...tuning, bank: null } as Tuning} staged={NOTHING} locked={null} />
        </LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
}

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  fetched.mockReset().mockImplementation(async ({ url }) => {
    const path = new URL(url).pathname;
    if (path === "/api/control")
      return Response.json({ epoch: 1, page: "k".repeat(16), name: "A. Operator" });
    if (path === "/api/session") return Response.json({ name: "A. Operator", role: "operator" });
    return Response.json(path === "/api/tuning/saved" ? { ...SAVED, who: null, at: null, moved: "" } : {});
  });
});
afterEach(cleanup);

const revert = () => screen.getByRole("button", { name: TEXTS.revert }) as HTMLButtonElement;

it.each(Object.keys(SAVED) as Part[])(
  "shows that %s differs from the saved tuning, and reverts it",
  async (part) => {
    open({ ...SAVED, [part]: OTHER[part] });
    await waitFor(() => expect(revert().disabled).toBe(false));
    const table = screen.getByRole("table", { name: TEXTS.tuningTable });
    expect(table.querySelectorAll("[data-differs=true]").length).toBe(1);
    fireEvent.click(revert());
    const request = () =>
      fetched.mock.calls.map(([request]) => request).find(({ method }) => method === "PUT");
    await waitFor(() => expect(request()).toBeDefined());
    expect(await request()?.clone().json()).toEqual(SAVED);
  },
);

it("shows which default of the method is not offered for these models", async () => {
  const moved =
    "the method's default is not offered for these models, the nearest that is: λ_q 0.5 → 0.965 s";
  const answer = fetched.getMockImplementation();
  fetched.mockImplementation(async (request) =>
    request.url.endsWith("/api/tuning/saved")
      ? Response.json({ ...SAVED, lam_q: 0.965, who: null, at: null, moved })
      : (answer as NonNullable<typeof answer>)(request),
  );
  open(OTHER);
  await waitFor(() => expect(revert().title).toBe(fillText(TEXTS.nothingSaved, { reason: moved })));
});

it("disables Revert while the active tuning equals the saved one", async () => {
  open(SAVED);
  await screen.findAllByText("0.500 s");
  await waitFor(() => expect(screen.getAllByText(TEXTS.switched).length).toBe(2));
  expect(revert().disabled).toBe(true);
});

it("disables its buttons during a trial without removing them", async () => {
  const trial = { ...SAVED, remaining_s: 8, until: 0 };
  const state = {
    trial,
    earlier: { ...SAVED, bank: null },
    touch: { learned: [] },
    holder: null,
    own_tuning: null,
  };
  open(OTHER, state);
  expect(screen.getByRole("button", { name: TEXTS.keep })).toBeDefined();
  for (const name of [TEXTS.revert, TEXTS.save, "Undo change"])
    expect((screen.getByRole("button", { name }) as HTMLButtonElement).disabled).toBe(true);
  expect((screen.getByRole("switch", { name: TEXTS.stage }) as HTMLInputElement).disabled).toBe(true);
});

it.each([
  ["earlier", "Undo change", SHARED.undoTo, "Redo change"],
  ["later", "Redo change", SHARED.redoTo, "Undo change"],
])("offers the step to the %s tuning and names that tuning", (which, name, begin, other) => {
  const steps = { earlier: null, later: null, [which]: { ...SAVED, bank: null } };
  open(OTHER, { trial: null, ...steps, touch: { learned: [] }, holder: null, own_tuning: null });
  const [button, without] = [name, other].map((one) =>
    screen.getByRole("button", { name: one }),
  ) as HTMLButtonElement[];
  expect(button?.title.startsWith(begin.replace("{tuning}", ""))).toBe(true);
  expect(without?.disabled).toBe(true);
});
