/** Region of a page with a title. */

import type { ReactNode } from "react";
import styles from "./Card.module.css";
import { ErrorBoundary } from "./ErrorBoundary";
import { Terms } from "./Explained";

interface CardProps {
  readonly title: string;
  /** Content at the right of the title. */
  readonly aside?: ReactNode;
  readonly children: ReactNode;
  readonly className?: string | undefined;
}

export function Card({ title, aside, children, className }: CardProps) {
  return (
    <section
      className={className === undefined ? styles.card : `${styles.card} ${className}`}
      aria-label={title}
    >
      <ErrorBoundary of={title}>
        <Terms>
          <div className={styles.head}>
            <h2 className={styles.title}>{title}</h2>
            {aside}
          </div>
          {children}
        </Terms>
      </ErrorBoundary>
    </section>
  );
}
