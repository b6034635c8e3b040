import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client stores fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  return replacement;
});

import type { ReactElement } from "react";
import { LiveProvider } from "../live/react";
import { LiveStore } from "../live/store";
import { DisturbanceCard } from "../pages/operate/DisturbanceCard";
import { ModeCard } from "../pages/operate/ModeCard";
import { TEXTS as OPERATE } from "../pages/operate/texts";
import { WallCard } from "../pages/operate/WallCard";
import DeveloperPage from "../pages/system/DeveloperPage";
import { TEXTS as SYSTEM } from "../pages/system/texts";
import { fillText } from "../samples/texts";
import type { PlantView, State } from "../wire/types";
import { PlantBadge } from "./Header";
import { Navigation } from "./Navigation";

const GEOMETRY = { r_m: 0.0075, r_j: 0.075 };
const PLANTS: Record<PlantView["kind"], PlantView> = {
  simulator: { kind: "simulator", simulated: true, name: "simulator", says: "simulator", ...GEOMETRY },
  rig: { kind: "rig", simulated: false, name: "rig", says: "NI PCIe-6323 as Dev1, on-demand", ...GEOMETRY },
  virtual_card: {
    kind: "virtual_card",
    simulated: true,
    name: "virtual card",
    says: "virtual NI PCIe-6323",
    ...GEOMETRY,
  },
  replay: { kind: "replay", simulated: false, name: "replay", says: "replay of run 7", ...GEOMETRY },
  package: { kind: "package", simulated: false, name: "servo-bench", says: "", ...GEOMETRY },
};
const KINDS = Object.keys(PLANTS) as PlantView["kind"][];

beforeEach(() => {
  fetched.mockReset().mockImplementation(async ({ url }) =>
    Response.json(
      new URL(url).pathname === "/api/faults"
        ? {
            faults: [
              { code: "stop_pressed", message: "", remedy: "", injection: null, by_hand: "press STOP" },
            ],
            card: [
              {
                injection: { kind: "lost_sample", sensor: "q" },
                says: "a sample is lost",
                leads_to: ["plant_error"],
              },
            ],
          }
        : { name: "Ana", role: "operator" },
    ),
  );
});
afterEach(cleanup);

function open(element: ReactElement, kind: PlantView["kind"], more: Partial<State> = {}): void {
  const store = new LiveStore(0);
  const plant = PLANTS[kind];
  store.setState({
    mode: "run",
    plant,
    limits: { F_push_max: plant.simulated ? 30 : 0, k_wall_min: 100, k_wall_max: 28000, c_wall_max: 7 },
    link: { starts: 1 },
    fault: null,
    ...more,
  } as unknown as State);
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient()}>
        <LiveProvider store={store}>{element}</LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
}

it.each([
  ["simulator", "SIM", "Simulator", "Simulator, parameters lab", "false"],
  ["rig", "RIG", "Rig", "NI PCIe-6323 as Dev1, on-demand, parameters lab", "true"],
  ["virtual_card", "VIRTUAL CARD", "Virtual card", "Virtual NI PCIe-6323, parameters lab", "false"],
  ["replay", "REPLAY", "Replay", "Replay of run 7, parameters lab", "false"],
  ["package", "servo-bench", "Servo-bench", "Servo-bench, parameters lab", "true"],
] as const)("has a badge for %s that distinguishes real plants", (kind, badge, name, title, real) => {
  render(<PlantBadge plant={PLANTS[kind]} parameters="lab" />);
  const shown = screen.getByRole("img", { name });
  expect([shown.textContent, shown.title, shown.dataset.real]).toEqual([badge, title, real]);
});

it("shows an unknown plant as unknown", () => {
  render(<PlantBadge plant={undefined} parameters={undefined} />);
  const shown = screen.getByRole("img", { name: "Plant unknown" });
  expect([shown.title, shown.dataset.real]).toEqual(["Plant unknown", undefined]);
});

it.each(KINDS)("offers the bring-up if there is a card: %s", (kind) => {
  open(<Navigation onSetup={() => undefined} onShortcuts={() => undefined} />, kind);
  const offered = screen.queryByRole("link", { name: "Bring-up" }) !== null;
  expect(offered).toBe(kind === "rig" || kind === "virtual_card");
});

it.each([
  ["simulator", "Inject faults into the simulator while"],
  ["virtual_card", "Inject faults into the virtual card while"],
  ["rig", "only into a simulated plant. Current plant: rig."],
  ["replay", "only into a simulated plant. Current plant: replay of a recording."],
  ["package", "only into a simulated plant. Current plant: “servo-bench” from a package."],
] as const)("shows the driven plant at the faults: %s", async (kind, words) => {
  open(<DeveloperPage />, kind);
  expect(document.body.textContent).toContain(words);
  const mend = await screen.findByRole<HTMLButtonElement>("button", { name: SYSTEM.clearAll });
  await waitFor(() => expect(mend.disabled).toBe(!PLANTS[kind].simulated));
});

it.each(KINDS)("offers a push by command if the joint is simulated: %s", (kind) => {
  open(<DisturbanceCard />, kind);
  expect(screen.queryByText(OPERATE.simulatedOnly) !== null).toBe(PLANTS[kind].simulated);
});

it.each(KINDS)("offers a wall if the joint is simulated: %s", (kind) => {
  open(<WallCard />, kind);
  expect(screen.queryByRole("button", { name: OPERATE.addWall }) !== null).toBe(PLANTS[kind].simulated);
});

it("injects a fault and a failure of the card with the same button", async () => {
  open(<DeveloperPage />, "virtual_card");
  const inject = await screen.findByRole<HTMLButtonElement>("button", {
    name: fillText(SYSTEM.injectNamed, { name: "a sample is lost" }),
  });
  expect(inject.disabled).toBe(false);
  const [faults, card] = screen.getAllByRole("table").map((table) => table.textContent);
  expect(faults).toContain("press STOP");
  expect(card).toContain("plant_error");
});

it.each([
  ["rig", true],
  ["package", false],
] as const)("shows the step required before pretension, with a link: %s", (kind, leads) => {
  open(<ModeCard />, kind, { mode: "off", legal_modes: [], unready: "set the zero in the bring-up" });
  expect(document.body.textContent).toContain("No pretension yet. Set the zero in the bring-up.");
  expect(screen.getByRole("button", { name: "Pretension" }).ariaDisabled).toBe("true");
  expect(screen.queryByRole("link", { name: "Go to Bring-up" }) !== null).toBe(leads);
});
