/** Machine, database, faults, set-up and bring-up: what the System, Developer and Bring-up pages read and do. */

import { queryOptions, useMutation, useQueryClient } from "@tanstack/react-query";
import { fillText } from "../../samples/texts";
import { BASE } from "../../wire/address";
import { answered, api, RequestError } from "../../wire/client";
import type { BringUp, BringUpStep, Injection } from "../../wire/types";
import { TEXTS } from "../texts";

export const checklistQuery = queryOptions({
  queryKey: ["checklist"],
  queryFn: async () => (await answered(api.GET("/api/checklist"))).steps,
});

/** Machine, database, safety: what the System and Developer pages read and do. */

export const systemQuery = queryOptions({
  queryKey: ["system"],
  queryFn: () => answered(api.GET("/api/system")),
  refetchInterval: 5000,
});

export const faultsQuery = queryOptions({
  queryKey: ["faults"],
  queryFn: () => answered(api.GET("/api/faults")),
  staleTime: Number.POSITIVE_INFINITY,
});

export function useBackupDatabase() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.POST("/api/system/backups")),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["system"] }),
  });
}

export function useCheckDatabase() {
  return useMutation({
    mutationFn: async () => (await answered(api.POST("/api/system/check"))).problems,
  });
}

export function useInjectFault() {
  return useMutation({
    mutationFn: (body: Injection) => answered(api.POST("/api/faults/injection", { body })),
  });
}

export function useEndInjection() {
  return useMutation({ mutationFn: () => answered(api.DELETE("/api/faults/injection")) });
}

/** Whether the way from this page's address to the service is set up right. */

interface AddressCheck {
  /** What is wrong, and how to set it right, in sentences. */
  readonly problems: readonly string[];
  /** Whether the service itself has found nothing wrong: what does not work then is something else. */
  readonly isAnswered: boolean;
}

const AGAIN_MS = 10_000;

/** Asked at the start, and once more when the live connection does not come about. */
export const addressCheckQuery = (isWithoutStream: boolean) =>
  queryOptions({
    queryKey: ["page-address", isWithoutStream],
    queryFn: () => addressCheckOf(answered(api.POST("/api/page-address", { body: { url: `${BASE}/` } }))),
    staleTime: Number.POSITIVE_INFINITY,
    refetchInterval: ({ state }) => (state.data?.problems.length === 0 ? false : AGAIN_MS),
  });

/** What the answer to the question says; a service that cannot be reached is told elsewhere. */
export async function addressCheckOf(
  asked: Promise<{ problems: { message: string }[] }>,
): Promise<AddressCheck> {
  try {
    const { problems } = await asked;
    return { problems: problems.map(({ message }) => message), isAnswered: true };
  } catch (error) {
    if (!(error instanceof RequestError) || error.status === 0) return { problems: [], isAnswered: false };
    return { problems: [error.problem?.message ?? notPassedOn(error.status)], isAnswered: false };
  }
}

function notPassedOn(status: number): string {
  const cookies = [400, 413, 431, 494].includes(status) ? ` ${TEXTS.largeCookies}` : "";
  return fillText(TEXTS.notSinew, { base: BASE, status }) + cookies;
}

/** Said when requests are answered and the live connection never comes about. */
export const NO_STREAM = TEXTS.noStream;

/** Bringing a rig up: the steps as they stand, and what a person does with them. */

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

type StepCommand =
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
