import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  return replacement;
});

import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { fillText } from "../../samples/texts";
import type { State } from "../../wire/types";
import { TEXTS } from "./texts";
import { WallCard } from "./WallCard";

function open(wall: State["wall"]): void {
  const store = new LiveStore(0);
  store.setState({
    plant: { simulated: true },
    wall,
    limits: { k_wall_min: 100, k_wall_max: 28000, c_wall_max: 7.396 },
    link: { alive: true },
    fault: null,
  } as unknown as State);
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient()}>
        <LiveProvider store={store}>
          <WallCard />
        </LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
}

async function ordered(): Promise<unknown[]> {
  const puts = fetched.mock.calls
    .map(([request]) => request)
    .filter(({ url }) => new URL(url).pathname === "/api/wall");
  return Promise.all(puts.map((request) => request.clone().json()));
}

beforeEach(() => {
  fetched.mockReset().mockImplementation(async ({ url }) => {
    const path = new URL(url).pathname;
    return Response.json(path === "/api/control" ? { epoch: 1, page: "k".repeat(16), name: "Ana" } : {});
  });
});
afterEach(() => {
  cleanup();
  localStorage.clear();
});

const ANGLE = fillText(TEXTS.wallAngle, { unit: "°" });

function enter(label: string, value: string): void {
  const box = screen.getByRole("textbox", { name: label });
  fireEvent.change(box, { target: { value } });
  fireEvent.blur(box);
}

it("adds the obstacle of the boxes in SI, and removes it", async () => {
  open(null);
  expect(screen.getByText(/^100 to 28.?000 N\/m, 0 to 7\.39 s\/m/)).toBeTruthy();
  enter(ANGLE, "-30");
  enter(TEXTS.wallStiffness, "5000");
  enter(TEXTS.wallDamping, "0.25");
  fireEvent.change(screen.getByRole("combobox", { name: TEXTS.wallSide }), {
    target: { value: "below" },
  });
  fireEvent.click(screen.getByRole("button", { name: TEXTS.addWall }));
  await waitFor(async () => expect(await ordered()).toHaveLength(1));
  const [{ wall }] = (await ordered()) as [{ wall: { q_wall: number } }];
  expect(wall).toEqual({
    q_wall: expect.closeTo(-Math.PI / 6, 10),
    side: "below",
    k_wall: 5000,
    c_wall: 0.25,
  });
  fireEvent.click(screen.getByRole("button", { name: TEXTS.removeWall }));
  await waitFor(async () => expect((await ordered())[1]).toEqual({ wall: null }));
});

it("shows the current obstacle, and sends no value that is not a number", async () => {
  open({ q_wall: Math.PI / 9, side: "above", k_wall: 20000, c_wall: 1 });
  const refusal = screen.getByRole("status", { name: "Refusal" });
  expect(screen.getByText(fillText(TEXTS.wallAbove, { angle: "20.0°" }))).toBeTruthy();
  enter(ANGLE, "far");
  fireEvent.click(screen.getByRole("button", { name: TEXTS.addWall }));
  await act(() => new Promise((resolve) => setTimeout(resolve, 20)));
  expect(await ordered()).toEqual([]);
  expect(refusal.textContent).toContain("Not sent. Press Esc to restore.");
  expect(screen.getByText(fillText(TEXTS.wallAbove, { angle: "20.0°" }))).toBeTruthy(); // a refusal does not hide the current obstacle
});
