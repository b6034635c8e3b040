/** A page fetches data again that another person has changed; it learns of the change from the state. */

import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, renderHook } from "@testing-library/react";
import type { ReactNode } from "react";
import { afterEach, expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import type { State } from "../../wire/types";
import { useRefetchOnChanges } from "./useRefetchOnChanges";

afterEach(cleanup);

function stateWith(starts: number, bank: number | null): State {
  return {
    link: { starts },
    tuning: { bank: bank === null ? null : { id: bank } },
    task: null,
    recording_run: null,
  } as unknown as State;
}

it("fetches predictions again when parameters or a bank become active, and not before", () => {
  const store = new LiveStore(0);
  const queries = new QueryClient();
  const asked = vi.spyOn(queries, "invalidateQueries");
  store.setState(stateWith(1, null));
  renderHook(() => useRefetchOnChanges(), {
    wrapper: ({ children }: { children: ReactNode }) => (
      <QueryClientProvider client={queries}>
        <LiveProvider store={store}>{children}</LiveProvider>
      </QueryClientProvider>
    ),
  });
  const keys = () => asked.mock.calls.map(([filter]) => filter?.queryKey?.[0]);
  asked.mockClear();
  act(() => store.setState(stateWith(1, null)));
  expect(keys()).toEqual([]);
  act(() => store.setState(stateWith(2, null)));
  expect(keys()).toEqual(expect.arrayContaining(["tuning", "parameters", "banks", "experiment-kinds"]));
  asked.mockClear();
  act(() => store.setState(stateWith(2, 7)));
  expect(keys()).toEqual(["banks", "tuning"]);
});
