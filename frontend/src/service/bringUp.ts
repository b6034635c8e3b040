/** Bringing a rig up: the steps as they stand, and what a person does with them. */

import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { answered, api } from "../wire/client";
import type { BringUp, BringUpStep } from "../wire/types";

const WHILE_RUNNING_MS = 400;
/** What blocks a step may come and go with the mode of the loop, also by somebody else's hand. */
const AT_REST_MS = 2000;

export const bringUpQuery = queryOptions({
  queryKey: ["bring-up"],
  queryFn: () => answered(api.GET("/api/bring-up")),
  refetchInterval: ({ state: { data } }) => (stepUnderWay(data) ? WHILE_RUNNING_MS : AT_REST_MS),
});

function stepUnderWay(data: BringUp | undefined): boolean {
  return data?.steps.some(({ running }) => running !== null) ?? false;
}

export type StepCommand =
  | { readonly do: "start"; readonly step: BringUpStep["id"]; readonly values: Record<string, number> }
  | { readonly do: "switch-drives"; readonly on: boolean }
  | { readonly do: "confirm" }
  | { readonly do: "cancel" };

/** What may be done about a step; each answer is how all stand then, and after a refusal that is asked for. */
export function useStepCommand() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (command: StepCommand) => answered(request(command)),
    onSuccess: (answer) => queries.setQueryData(bringUpQuery.queryKey, answer),
    onSettled: () => queries.invalidateQueries({ queryKey: bringUpQuery.queryKey }),
  });
}

function request(command: StepCommand) {
  switch (command.do) {
    case "start": {
      const { step, values } = command;
      return api.POST("/api/bring-up/{step}", { params: { path: { step } }, body: { values } });
    }
    case "switch-drives":
      return api.POST("/api/bring-up/drives", { body: { on: command.on } });
    case "confirm":
      return api.POST("/api/bring-up/confirm");
    case "cancel":
      return api.POST("/api/bring-up/cancel");
  }
}
