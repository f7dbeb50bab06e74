"""Force sensor that uses Raw Data Transfer (RDT) over UDP, as ATI's Net F/T and Ethernet Axia do."""
