/** Requests of the System, Developer and Bring-up pages: machine, database, faults, setup and commissioning. */

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

/** Result of the check whether requests to this page's address reach the service correctly. */

interface AddressCheck {
  /** Sentences that state each problem and its remedy. */
  readonly problems: readonly string[];
  /** Whether the service completed the check. */
  readonly isAnswered: boolean;
}

const AGAIN_MS = 10_000;

/** Checks the address at the start, and once more if the live connection fails. */
export const addressCheckQuery = (isWithoutStream: boolean) =>
  queryOptions({
    queryKey: ["page-address", isWithoutStream],
    queryFn: () => addressCheckOf(answered(api.POST("/api/page-address", { body: { url: `${BASE}/` } }))),
    staleTime: Number.POSITIVE_INFINITY,
    refetchInterval: ({ state }) => (state.data?.problems.length === 0 ? false : AGAIN_MS),
  });

/** Converts the answer to problems; other parts of the page report an unreachable service. */
export async function addressCheckOf(
  request: Promise<{ problems: { message: string }[] }>,
): Promise<AddressCheck> {
  try {
    const { problems } = await request;
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

/** Shown if the service answers requests and the live connection fails. */
export const NO_STREAM = TEXTS.noStream;

const WHILE_RUNNING_MS = 400;
/** The mode of the loop can block a step, and another person may change the mode. */
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

/** Sends a command about a step; each answer contains all steps, and the page fetches them after each command. */
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
