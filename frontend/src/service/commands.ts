/** Everything that changes something. Sent once, never repeated by itself; what came into force is read back. */

import { useMutation, useQueryClient } from "@tanstack/react-query";
import { answered, api } from "../wire/client";
import { giveUpControl, heldEpoch } from "../wire/control";
import type {
  BankFile,
  IdentificationRequest,
  Mode,
  SpringTableRequest,
  TouchOrder,
  TuningRequest,
  Wall,
} from "../wire/types";
import { renameDrafts } from "./drafts";
import { sessionQuery } from "./queries";

export function useSetMode() {
  return useMutation({ mutationFn: (mode: Mode) => answered(api.POST("/api/mode", { body: { mode } })) });
}

export function useReset() {
  return useMutation({ mutationFn: () => answered(api.POST("/api/reset")) });
}

/** A push on the joint of a simulated plant; one of 0 N lets go. */
export function usePush() {
  return useMutation({
    mutationFn: (body: { F_push: number; duration_s: number }) => answered(api.POST("/api/push", { body })),
  });
}

/** What is learned of the outside force, and from what force on the joint gives way. */
export function useTouch() {
  return useMutation({
    mutationFn: (what: Partial<TouchOrder>) =>
      answered(api.PUT("/api/touch", { body: { learn: false, forget: false, ...what } })),
  });
}

/** A wall in the way of a simulated joint; null takes it away. */
export function useSetWall() {
  return useMutation({
    mutationFn: (body: { wall: Wall | null }) => answered(api.PUT("/api/wall", { body })),
  });
}

export function useSetTuning() {
  return useMutation({ mutationFn: (body: TuningRequest) => answered(api.PUT("/api/tuning", { body })) });
}

export function useTryTuning() {
  return useMutation({
    mutationFn: (body: TuningRequest & { duration_s: number }) =>
      answered(api.POST("/api/tuning/trial", { body })),
  });
}

/** Ends a trial: keeps what is tried, or puts the earlier tuning back at once. */
export function useEndTrial() {
  return useMutation({
    mutationFn: (keep: boolean) =>
      answered(keep ? api.POST("/api/tuning/trial/keep") : api.DELETE("/api/tuning/trial")),
  });
}

export function useSaveTuning() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.PUT("/api/tuning/saved")),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["tuning", "saved"] }),
  });
}

export function useStartIdentification() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: IdentificationRequest) => answered(api.POST("/api/identifications", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["identifications"] }),
  });
}

export function useAddSpringTable() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: SpringTableRequest) => answered(api.POST("/api/spring-tables", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["spring-tables"] }),
  });
}

export function useImportBank() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: BankFile) => answered(api.POST("/api/banks/file", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["banks"] }),
  });
}

export function useBuildBank() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: { name: string; identifications: number[] }) =>
      answered(api.POST("/api/banks", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["banks"] }),
  });
}

export function useActivateBank() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (id: number) => answered(api.POST("/api/banks/{id}/activate", { params: { path: { id } } })),
    onSuccess: () =>
      Promise.all(["banks", "tuning"].map((key) => queries.invalidateQueries({ queryKey: [key] }))),
  });
}

/** Gains from the plant's geometry again, no bank. */
export function useGeometry() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.POST("/api/banks/geometry/activate")),
    onSuccess: () =>
      Promise.all(["banks", "tuning"].map((key) => queries.invalidateQueries({ queryKey: [key] }))),
  });
}

/** Undoes the last change of what is in force, or does again what was undone last. */
export function useTuningStep(step: "undo" | "redo") {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.POST(`/api/tuning/${step}`)),
    onSuccess: () =>
      Promise.all(["banks", "tuning"].map((key) => queries.invalidateQueries({ queryKey: [key] }))),
  });
}

export type SettingValues = Record<string, boolean | number | string>;

/** Looks an experiment over as a start would; nothing is kept. */
export function useCheckExperiment() {
  return useMutation({
    mutationFn: (text: string) =>
      answered(api.POST("/api/experiments/check", { body: { text, play: true } })),
  });
}

/** Keeps an experiment as the next version of its name. */
export function useKeepExperiment() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (text: string) => answered(api.POST("/api/experiments/own", { body: { text } })),
    onSuccess: () =>
      Promise.all(
        ["experiment-kinds", "experiment-versions", "experiment-texts"].map((key) =>
          queries.invalidateQueries({ queryKey: [key] }),
        ),
      ),
  });
}

export function useStartExperiment() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: { name: string; settings: SettingValues }) =>
      answered(api.POST("/api/experiments", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["runs"] }),
  });
}

/** What may be done to the queue; each answer is the queue as it is then. */
export function useQueueCommand() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (command: QueueCommand) => answered(queueRequest(command)),
    onSuccess: (queue) => queries.setQueryData(["queue"], queue),
  });
}

type QueueCommand =
  | { readonly do: "add"; readonly name: string; readonly settings: SettingValues }
  | { readonly do: "remove"; readonly id: number }
  | { readonly do: "move"; readonly id: number; readonly place: number }
  | { readonly do: "run" }
  | { readonly do: "hold" };

function queueRequest(command: QueueCommand) {
  switch (command.do) {
    case "add": {
      const { name, settings } = command;
      return api.POST("/api/experiments/queue", { body: { name, settings } });
    }
    case "remove":
      return api.DELETE("/api/experiments/queue/{id}", { params: { path: { id: command.id } } });
    case "move": {
      const { id, place } = command;
      return api.PUT("/api/experiments/queue/{id}/place", { params: { path: { id } }, body: { place } });
    }
    case "run":
      return api.POST("/api/experiments/queue/run");
    case "hold":
      return api.POST("/api/experiments/queue/hold");
  }
}

/** Let the 3D view of the replay show a moment of a run. */
export function showMoment(run: number, t: number) {
  return answered(api.POST("/api/runs/{id}/replay", { params: { path: { id: run } }, body: { t } }));
}

export function useSetNote(id: number) {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (note: string) =>
      answered(api.PATCH("/api/runs/{id}", { params: { path: { id } }, body: { note } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["runs"] }),
  });
}

/** Puts a tag on a run, or takes it off. */
export function useTag(id: number) {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: ({ tag, put }: { tag: string; put: boolean }) =>
      answered(
        put
          ? api.POST("/api/runs/{id}/tags", { params: { path: { id } }, body: { tag } })
          : api.DELETE("/api/runs/{id}/tags/{tag}", { params: { path: { id, tag } } }),
      ),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["runs"] }),
  });
}

export function useSaveSearch() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: ({ name, where }: { name: string; where: string }) =>
      answered(api.PUT("/api/saved-searches/{name}", { params: { path: { name } }, body: { where } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["saved-searches"] }),
  });
}

export function useForgetSearch() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (name: string) =>
      answered(api.DELETE("/api/saved-searches/{name}", { params: { path: { name } } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["saved-searches"] }),
  });
}

export function useSignIn() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: { token: string; name: string }) => answered(api.POST("/api/session", { body })),
    onSuccess: () => queries.invalidateQueries(),
  });
}

/** Says by what name this browser's person goes. */
export function useSetName() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (name: string) => answered(api.PUT("/api/session/name", { body: { name } })),
    onSuccess: (session) => {
      const before = queries.getQueryData(sessionQuery.queryKey);
      if (before !== undefined) renameDrafts(before.name, session.name);
      queries.setQueryData(sessionQuery.queryKey, session);
      void queries.invalidateQueries({ queryKey: ["preferences"] });
    },
  });
}

/** Ends this browser's session for good. Control goes first: a page that is only missed would be taken for lost. */
export function useSignOut() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: async () => {
      if (heldEpoch() !== null) await giveUpControl();
      return answered(api.DELETE("/api/session"));
    },
    onSuccess: () => queries.resetQueries(),
  });
}

/** Computes the result of a run from what is stored of it. */
export function useEvaluate(run: number) {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: () => answered(api.POST("/api/runs/{id}/evaluation", { params: { path: { id: run } } })),
    onSettled: () => queries.invalidateQueries({ queryKey: ["runs"] }),
  });
}
