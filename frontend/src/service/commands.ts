/** Everything that changes something. Sent once, never repeated by itself; what came into force is read back. */

import { useMutation, useQueryClient } from "@tanstack/react-query";
import { answered, api } from "../wire/client";
import type { IdentificationRequest, Mode, References, TuningRequest } from "../wire/types";

export function useSetMode() {
  return useMutation({ mutationFn: (mode: Mode) => answered(api.POST("/api/mode", { body: { mode } })) });
}

export function useReset() {
  return useMutation({ mutationFn: () => answered(api.POST("/api/reset")) });
}

export function useSetReferences() {
  return useMutation({ mutationFn: (body: References) => answered(api.PUT("/api/references", { body })) });
}

export function useSetTuning() {
  return useMutation({ mutationFn: (body: TuningRequest) => answered(api.PUT("/api/tuning", { body })) });
}

export function useStartIdentification() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: IdentificationRequest) => answered(api.POST("/api/identifications", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["identifications"] }),
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

export type SettingValues = Record<string, boolean | number | string>;

export function useStartExperiment() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: { name: string; settings: SettingValues }) =>
      answered(api.POST("/api/experiments", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["runs"] }),
  });
}

export function useSetNote(id: number) {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (note: string) =>
      answered(api.PATCH("/api/runs/{id}", { params: { path: { id } }, body: { note } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["runs"] }),
  });
}

export function useSignIn() {
  const queries = useQueryClient();
  return useMutation({
    mutationFn: (body: { token: string; name: string }) => answered(api.POST("/api/session", { body })),
    onSuccess: () => queries.invalidateQueries(),
  });
}
