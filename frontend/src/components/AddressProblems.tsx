/** Shows problems of the page's address and how to correct them, before a person sends commands. */

import { useQuery } from "@tanstack/react-query";
import { useLive } from "../live/react";
import { capital } from "../samples/format";
import { addressCheckQuery, NO_STREAM } from "../service/api/system";
import styles from "./AddressProblems.module.css";
import { TEXTS } from "./texts";

/** Failed attempts, about two seconds, after which the first connection counts as missing. */
const ATTEMPTS = 3;

/** Problems on a page with the live stream. */
export function AddressProblems() {
  const isWithoutStream = useLive(({ link }) => link.received_ms === null && link.failures >= ATTEMPTS);
  return <Problems isWithoutStream={isWithoutStream} />;
}

/** Problems on a page without a live stream. */
export function Problems({ isWithoutStream = false }: { isWithoutStream?: boolean }) {
  const { data: check } = useQuery(addressCheckQuery(isWithoutStream));
  if (check === undefined) return null;
  const problems = isWithoutStream && check.isAnswered ? [...check.problems, NO_STREAM] : check.problems;
  if (problems.length === 0) return null;
  return (
    <div className={styles.problems} role="alert" aria-label={TEXTS.addressSetup}>
      {problems.map((problem) => (
        <p key={problem}>
          <strong>{TEXTS.addressWrong}</strong> {capital(problem)}
        </p>
      ))}
      {!check.isAnswered && <p>{TEXTS.addressNoStop}</p>}
    </div>
  );
}
