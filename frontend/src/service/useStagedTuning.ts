/** λ that were chosen but not sent: kept in the browser, so that a reload or a lost link does not lose them. */

import { useLocalStorage } from "@mantine/hooks";

export type LambdaName = "lam_q" | "lam_S";
export type StagedLambdas = Partial<Record<LambdaName, number>>;

interface Staged {
  /** Whether changes are gathered instead of being sent. */
  readonly staging: boolean;
  readonly values: StagedLambdas;
}

const NOTHING: Staged = { staging: false, values: {} };

export interface Staging extends Staged {
  turn(on: boolean): void;
  stage(name: LambdaName, value: number): void;
  discard(): void;
}

export function useStagedTuning(): Staging {
  const [staged, set] = useLocalStorage<Staged>({
    key: "sinew-staged-tuning",
    defaultValue: NOTHING,
    getInitialValueInEffect: false,
    deserialize: (text) => parsed(text),
  });
  return {
    ...staged,
    turn: (staging) => set({ staging, values: {} }),
    stage: (name, value) => set((before) => ({ ...before, values: { ...before.values, [name]: value } })),
    discard: () => set((before) => ({ ...before, values: {} })),
  };
}

/** What another version of the page may have left is not trusted. */
function parsed(text: string | undefined): Staged {
  try {
    const { staging, values } = JSON.parse(text ?? "") as Staged;
    const numbers = Object.entries(values).filter(([, value]) => Number.isFinite(value));
    return { staging: staging === true, values: Object.fromEntries(numbers) };
  } catch {
    return NOTHING;
  }
}
