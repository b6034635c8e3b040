/** A run of any kind has a report to download once it has ended, and none before. */
import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, render, screen } from "@testing-library/react";
import { expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import type { Run } from "../../wire/types";
import { NoteCard } from "./RunDetail";

function reports(kind: string, end_state: string): number {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  Object.defineProperty(document, "fonts", { value: new EventTarget(), configurable: true });
  render(
    <QueryClientProvider client={new QueryClient()}>
      <MantineProvider>
        <LiveProvider store={new LiveStore(0)}>
          <NoteCard run={{ id: 7, kind, end_state, note: "" } as Run} />
        </LiveProvider>
      </MantineProvider>
    </QueryClientProvider>,
  );
  const found = screen.queryAllByRole("link", { name: /^Report/ });
  for (const link of found) expect(link.getAttribute("href")).toMatch(/^\.\/api\/runs\/7\/report\./);
  cleanup();
  return found.length;
}

it("offers the report of a run of any kind once it has ended", () => {
  for (const kind of ["tracking", "experiment", "sequence", "session", "actuator_identification"]) {
    expect(reports(kind, "completed")).toBe(2);
    expect(reports(kind, "tripped")).toBe(2);
    expect(reports(kind, "running")).toBe(0);
  }
});
