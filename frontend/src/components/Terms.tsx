/**
 * Words that explain themselves, together one stop of the Tab key: the arrow keys go from one to the next. So help in
 * place makes the way round a page no longer than by one stop for each of its parts.
 */

import {
  createContext,
  type KeyboardEvent,
  type ReactNode,
  useContext,
  useMemo,
  useSyncExternalStore,
} from "react";

export interface Group {
  /** Where the Tab key comes in. */
  current(): HTMLElement | null;
  subscribe(listener: () => void): () => void;
  add(term: HTMLElement): () => void;
  enter(term: HTMLElement): void;
  size(): number;
  move(event: KeyboardEvent<HTMLElement>): void;
}

const STEPS: Readonly<Record<string, number>> = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };

export function group(): Group {
  const terms = new Set<HTMLElement>();
  const listeners = new Set<() => void>();
  let at: HTMLElement | null = null;
  const inOrder = () =>
    [...terms].sort((a, b) => (a.compareDocumentPosition(b) & Node.DOCUMENT_POSITION_FOLLOWING ? -1 : 1));
  const become = (term: HTMLElement | null) => {
    if (term === at) return;
    at = term;
    for (const listener of listeners) listener();
  };
  return {
    current: () => at,
    subscribe(listener) {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    add(term) {
      terms.add(term);
      if (at === null) become(term);
      return () => {
        terms.delete(term);
        if (at === term) become(inOrder()[0] ?? null);
      };
    },
    enter: become,
    size: () => terms.size,
    move(event) {
      const ordered = inOrder();
      const here = ordered.indexOf(event.currentTarget);
      const ends: Readonly<Record<string, number>> = { Home: 0, End: ordered.length - 1 };
      const step = STEPS[event.key];
      const to = ends[event.key] ?? (step === undefined ? undefined : here + step);
      if (to === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      event.stopPropagation();
      ordered[to]?.focus();
    },
  };
}

const GroupContext = createContext<Group | null>(null);

export function useGroup(): Group | null {
  return useContext(GroupContext);
}

const never = () => () => {};

/** Whether the Tab key comes to this word: to one of each group, to each that is in none. */
export function useTabStop(of: Group | null, term: HTMLElement | null): boolean {
  const at = useSyncExternalStore(of?.subscribe ?? never, () => of?.current() ?? null);
  return of === null || (term !== null && at === term);
}

export function Terms({ children }: { children: ReactNode }) {
  const one = useMemo(group, []);
  return <GroupContext value={one}>{children}</GroupContext>;
}
